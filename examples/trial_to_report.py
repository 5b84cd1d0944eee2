"""From raw logs to a report, as a script: no notebook, no command line.

Run it with the logs of your trials, or without any to make four virtual trials first:

    python examples/trial_to_report.py data/samples
"""

from __future__ import annotations

import sys
from pathlib import Path

import granite_lab as gl


def virtual_trials(folder: Path) -> list[Path]:
    """Let the model drive, and write what its sensors would log."""
    logs = []
    for number, velocity in enumerate((0.2, 0.3, 0.5, 0.7)):
        log = folder / f"virtual_v{velocity:g}.csv"
        gl.simulate(velocity, log=log, seed=number)
        logs.append(log)
    return logs


def main(logs: list[Path], out: Path) -> None:
    """Take trials through the chain and print what comes out."""
    out.mkdir(parents=True, exist_ok=True)
    logs = logs or virtual_trials(out / "logs")

    # What does a log hold? Nothing is assumed: units, clocks and gaps are looked at.
    first = next(iter(sorted(logs[0].glob("*.csv"))), logs[0])
    seen = gl.inspect(first)
    print(seen.files[0].problem or seen.to_frame()[["column", "channels", "unit"]].to_string(index=False))

    # Velocity and slip with their uncertainty; a pandas table with units in the column names.
    motions = gl.ingest(logs)
    for trial in motions:
        slip = trial.motion.slip_ratio
        print(f"{trial.name}: slip ratio {100 * slip.value:.2f} ± {100 * slip.std:.2f} %")
    motions.to_frame().to_csv(out / "motion.csv", index=False)

    # Does the model of the paper explain it, and with which k_92 and a_θ?
    study = gl.study(logs, out=out / "report", discover=False)
    print(study.to_frame()[["trial", "k92", "k92_std", "slip_ratio", "slip_ratio_simulated"]])
    if study.a_theta is not None:
        a_theta = study.a_theta.a_theta
        print(f"a_θ = {a_theta.value:.2f} ± {a_theta.std:.2f} s/m (published: 4.919)")
    print(f"report: {out / 'report' / 'index.html'}")

    # What is missing from the model? It takes minutes for a dozen trials: gl.discover(logs, jobs=0).


if __name__ == "__main__":
    try:
        main([Path(argument) for argument in sys.argv[1:]], Path("reports/example"))
    except gl.LabError as error:
        sys.exit(f"error: {error.message}\nhint: {error.hint}")
