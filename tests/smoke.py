"""Run every command of the README once, on few trials, as a user who has installed the package alone.

    python tests/smoke.py

Each must end with exit code 0 and print something; all of the command line must be among them. No test of
numbers, and no need of pytest: `make smoke` runs it in an environment without the tools of development.
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parent.parent
SAMPLES = ("virtual_v0.5_r1", "virtual_v0.7_r2")

RUN = "import sys; from granite_lab.cli import main; sys.argv[0] = 'granite-lab'; main()"

FASTER = {"study": ("--no-discover", "--no-recordings"), "hide": ("--repetitions", "1")}
"""Options that make a command do less: `discover` searches, the tests look at recordings."""

NOT_RUN = {"view": "opens a window"}


def lines() -> list[list[str]]:
    """Return the commands of the README as lists of words."""
    blocks = re.findall(r"```sh\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    words = [shlex.split(line, comments=True) for block in blocks for line in block.splitlines()]
    return [line[1:] for line in words if line[:1] == ["granite-lab"]]


def prepare(folder: Path) -> None:
    """Put what the README speaks of into a folder."""
    for place in ("trials", "data/samples"):
        (folder / place).mkdir(parents=True)
        for name in SAMPLES:
            shutil.copy(ROOT / "data" / "samples" / f"{name}.csv", folder / place)
    shutil.copy(ROOT / "data" / "samples" / "virtual_v0.7_r1.csv", folder / "data" / "samples")
    shutil.copy(ROOT / "data" / "samples" / f"{SAMPLES[0]}.csv", folder / "trial.csv")
    example: dict[str, str] = {}
    exec((ROOT / "tests" / "effects" / "example.py").read_text(encoding="utf-8"), example)
    (folder / "my_effect.py").write_text(example["EXAMPLE"], encoding="utf-8")


def run(words: list[str], folder: Path) -> str:
    """Run a command; return what is wrong with how it ended."""
    if words[0] == "compare-studies":
        for name in words[1:3]:
            shutil.copytree(folder / "reports" / "my-sand", folder / name)
    begin = time.monotonic()
    argv = [sys.executable, "-W", "error::SyntaxWarning", "-c", RUN, *words, *FASTER.get(words[0], ())]
    done = subprocess.run(argv, cwd=folder, capture_output=True, text=True, check=False)
    print(f"{time.monotonic() - begin:6.1f} s  granite-lab {shlex.join(words)}", flush=True)
    if done.returncode or "Traceback" in done.stderr:
        return f"exit code {done.returncode}: {done.stderr.strip()}"
    return "" if done.stdout.strip() else "prints nothing"


def main() -> int:
    """Run all; return the exit code."""
    from granite_lab.cli import COMMANDS

    commands = lines()
    missing = set(COMMANDS) - {words[0] for words in commands}
    wrong = [f"granite-lab {name}: is not in the README" for name in sorted(missing)]
    with tempfile.TemporaryDirectory(prefix="granite-lab-smoke-") as temporary:
        folder = Path(temporary)
        prepare(folder)
        for words in commands:
            if trouble := run([words[0], "--help"] if words[0] in NOT_RUN else words, folder):
                wrong.append(f"granite-lab {shlex.join(words)}: {trouble}")
    print("\n".join(wrong) if wrong else f"{len(commands)} commands ended well")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
