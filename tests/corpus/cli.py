"""The command line in this process: `main()` with its output and exit code."""

import contextlib
import io
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from granite_lab.cli import main
from granite_lab.parameters.catalogue import clear_cache
from tests.logs import make

ROOT = Path(__file__).parent.parent.parent
SAMPLES = ROOT / "data" / "samples"
GRANITE = (ROOT / "granite_lab/catalogue/robots/granite.toml").read_text(encoding="utf-8")
SAND = (ROOT / "granite_lab/catalogue/soils/dry_sand.toml").read_text(encoding="utf-8")
CODES = (0, 1, 2, 3, 4, 130)
LOG = make.text()


@dataclass(frozen=True)
class Done:
    """What a command left: exit code, stdout and stderr."""

    code: int
    out: str
    err: str

    def said(self, head: str) -> str:
        """Return the last line of stderr that begins with a word, without that."""
        lines = [line.removeprefix(head) for line in self.err.splitlines() if line.startswith(head)]
        return lines[-1] if lines else ""

    error = property(lambda self: self.said("error: "))
    hint = property(lambda self: self.said("hint: "))


def lab(*args: object, cwd: Path | None = None) -> Done:
    """Run a command as a user does, errors and all; an exception that escapes is the test's failure."""
    clear_cache()  # another process would read every file anew
    out, err, before = io.StringIO(), io.StringIO(), sys.argv
    sys.argv = ["granite-lab", *map(str, args)]
    code = 0
    try:
        with contextlib.chdir(cwd or "."), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    finally:
        sys.argv = before
    return Done(code, out.getvalue(), err.getvalue())


def succeeded(*args: object, cwd: Path | None = None) -> Done:
    """Run a command that ends well."""
    done = lab(*args, cwd=cwd)
    assert done.code == 0, done.err
    return done


def strict(text: str) -> Any:
    """Read JSON that holds neither NaN nor infinity, which Python would read."""

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    return json.loads(text, parse_constant=refuse)


def told(*args: object, cwd: Path | None = None) -> dict[str, Any]:
    """Run a command that ends well and return its one document, which says of which command it is."""
    found: dict[str, Any] = strict(succeeded(*args, "--json", cwd=cwd).out)
    assert str(args[0]).startswith(found["schema"].split("/")[1]), found["schema"]
    return found


def refused(done: Done, code: int, error: str, hint: str = "") -> None:
    """Hold a refusal to its promises: one line, a hint, the exit code, and nothing on stdout."""
    assert done.code == code, done
    assert error in done.error, done.err
    assert hint in done.hint, done.err
    assert done.hint, done.err
    assert "Traceback" not in done.err
    assert done.out == ""
