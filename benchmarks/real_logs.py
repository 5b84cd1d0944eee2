"""Estimates on logs of other robots, against the references that came with them.

The logs are those of `tests/logs/test_real_logs.py`; they are not part of the project.

``python -m benchmarks.real_logs --data FOLDER [--out docs/estimation-real.md]``
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.real_logs_data import CAR_RUNS, boreal, car, husky, kobuki, sliding, yaw_lag
from benchmarks.real_logs_page import page
from benchmarks.real_logs_plots import draw


def main() -> None:
    """Run every log, write the page and its figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--data", type=Path, required=True, help="folder with the logs")
    parser.add_argument("--out", type=Path, default=Path("docs/estimation-real.md"))
    args = parser.parse_args()
    cars = [car(args.data, run) for run in CAR_RUNS]
    gps, snow = husky(args.data), boreal(args.data)
    draw(args.out.parent / "figures", gps, cars, snow)
    text = page(gps, yaw_lag(args.data), cars, snow, kobuki(args.data), sliding(args.data))
    args.out.write_text(text, encoding="utf-8")
    print(args.out)


if __name__ == "__main__":
    main()
