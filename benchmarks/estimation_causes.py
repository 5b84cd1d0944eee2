"""What the page of the estimation benchmark says about the causes of the errors that remain."""

CAUSES = """\
## Causes of the remaining errors

* **Gyro noise.** Over 30 s between two standstills the white noise of the consumer gyro (0.12 mrad/√s) alone
  gives a velocity error of 14 mm/s in the middle: 2 points of λ_R at 0.7 m/s, 7 at 0.2 m/s. That slip changes
  slowly reduces this to about one point.
* **Jitter of the stamps** turns vibration into white noise; the std contains it.
* **Correlation time of slip.** 2 s is assumed; the likelihood hardly distinguishes 2 s from 4 s. In 160
  trials of 30 s the mean NEES is 1.00, with 3 s 0.64 and with 1 s up to 1.6.
* **Surge at 1 Hz** looks like changing slip: the std of industrial trials of 30 s at 0.2 and 0.3 m/s is too
  large. A smooth law of slip or a state for the surge does not improve the NEES.
* **Slip on the ramps.** λ_R of consumer IMUs is too large by 0.1 to 0.4 points at 0.2 and 0.3 m/s. The cause
  is the slip that is expected there. Other expectations move the error to 0.5 and 0.7 m/s.
"""
