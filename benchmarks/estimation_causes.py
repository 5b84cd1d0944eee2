"""What the page of the estimation benchmark says about the causes of the errors that remain."""

CAUSES = """\
## Causes of the remaining errors

* **Sensors.** Over 30 s between two standstills the white noise of the consumer gyro (0.12 mrad/√s) alone
  gives a velocity error of g · 0.12 mrad/√s · √(T³/192) = 14 mm/s in the middle: 2 points of λ_R at 0.7
  m/s, 7 at 0.2 m/s. Slowly changing slip reduces this to about one point.
* **Stamps and scale.** Stamps that scatter by 0.1 ms turn vibration into white noise. With even stamps the
  NEES of 150 industrial trials (8 s, 0.7 m/s) falls from 1.10 ± 0.08 to 1.00, without a scale error of the
  accelerometer to 1.07. The std contains both.
* **Correlation time of slip**, 2 s, is assumed; the likelihood hardly distinguishes 2 s from 4 s. In 160
  trials of 30 s the mean NEES is 1.00, with 2.5 s 0.92, with 3 s 0.64 and with 1 s up to 1.6.
* **Surge at 1 Hz** looks like changing slip: the scatter of slip is 1.4 times too large in industrial
  trials of 30 s at 0.2 and 0.3 m/s, and the std too cautious. With the true scatter and 1.25 s, the NEES is
  1.3 and λ_R no better. A smooth law of slip leaves the NEES as it is (60 trials); a state for the surge
  raises it to 1.5 to 2.2 at 0.5 and 0.7 m/s.
* **Slip on the ramps.** λ_R of consumer IMUs is too large by 0.1 to 0.4 points at 0.2 and 0.3 m/s, from the
  slip that is expected on the ramps. An expectation 0.08 s later lowers this to −0.03 and +0.12 points, but
  gives −0.28 and −0.36 at 0.5 and 0.7 m/s. No change of slip on the ramps gives about the same. Both were
  rejected.
"""
