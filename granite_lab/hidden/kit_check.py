"""Check a kit for granite-lab, and seal its answer. Needs Python 3.11 or newer and nothing else.

python check.py           says what is missing or wrong; exit code 0 or 3
python check.py --seal    the same, then writes sealed.bin and its hash into seal.sha256
"""

from __future__ import annotations

import base64
import csv
import hashlib
import json
import math
import secrets
import sys
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

HEAD = b"granite-lab sealed answer 1; opened by: granite-lab reveal\n"
ANSWER, ALLOWED, SEALED, HASH = "answer.json", "allowed.json", "sealed.bin", "seal.sha256"
SCHEMA = "granite-lab/kit-answer/1"
OUTSIDE = "unknown"
NEEDED = (
    "t", "imu_ax", "imu_az", "imu_gy", "enc_fl", "enc_fr", "enc_rl", "enc_rr",
)  # fmt: skip
COMMAND = ("v_desired_mps", "a_max_mps2", "distance_m")
LOGS = (".csv", ".bag", ".mcap")


def seal(answer: Mapping[str, Any]) -> bytes:
    """Return the answer as the bytes of a sealed file: not to be read by accident, nor changed unseen."""
    plain = json.dumps(answer, sort_keys=True, allow_nan=False).encode()
    body = base64.encodebytes(zlib.compress(plain, 9)[::-1])
    return HEAD + hashlib.sha256(plain).hexdigest().encode() + b"\n" + body


def logs_of(kit: Path) -> list[Path]:
    """Return the logs of a kit."""
    return sorted(path for path in (kit / "trials").glob("*") if path.suffix.lower() in LOGS)


def problems(kit: Path) -> tuple[list[str], list[str]]:
    """Return what makes a kit unusable, and what makes it weaker."""
    wrong, weak = _answer_problems(kit), []
    logs = logs_of(kit)
    if not logs:
        wrong.append("trials/: contains no log (.csv, .bag, .mcap)")
    elif len(logs) < 6:
        weak.append(f"trials/: {len(logs)} logs; a small effect needs more: four speeds, three repetitions")
    commands = set()
    mapped = (kit / "trials" / "map.toml").is_file()
    for log in logs:
        if log.suffix.lower() == ".csv" and not mapped:
            found, command = _log_problems(log)
            wrong += found
            commands.add(command)
    if len(commands) == 1 and len(logs) > 1:
        weak.append("trials/: all at one speed; most effects differ only in their dependence on speed")
    return wrong, weak


def _answer_problems(kit: Path) -> list[str]:
    try:
        answer = json.loads((kit / ANSWER).read_text(encoding="utf-8"))
        allowed = json.loads((kit / ALLOWED).read_text(encoding="utf-8"))["effects"]
    except OSError as error:
        return [f"{Path(error.filename).name}: cannot be read"]
    except (ValueError, KeyError, TypeError) as error:
        return [f"{ANSWER} or {ALLOWED}: not valid: {error}"]
    if not isinstance(answer, dict) or answer.get("schema") != SCHEMA:
        return [f"{ANSWER}: schema is not {SCHEMA}"]
    wrong = []
    if not str(answer.get("made_by") or "").strip():
        wrong.append(f"{ANSWER}: made_by is empty: name the laboratory or the simulator")
    if not isinstance(answer.get("virtual"), bool):
        wrong.append(f"{ANSWER}: virtual is neither true (a simulator) nor false (measured)")
    effects = answer.get("effects")
    if not isinstance(effects, list) or not all(isinstance(e, dict) for e in effects):
        return [*wrong, f"{ANSWER}: effects is not a list of objects; [] means that nothing is missing"]
    for effect in effects:
        wrong += [f"{ANSWER}: {text}" for text in _effect_problems(effect, allowed)]
    return wrong


def _effect_problems(effect: Mapping[str, Any], allowed: Mapping[str, Any]) -> list[str]:
    name, sizes = str(effect.get("id")), effect.get("parameters", {})
    if name == OUTSIDE:
        return [] if str(effect.get("title") or "").strip() else [f"'{OUTSIDE}' needs a title: what it is"]
    if name not in allowed:
        return [f"'{name}' is not an id of {ALLOWED}; another cause is '{OUTSIDE}' with a title"]
    known, wrong = allowed[name]["parameters"], []
    if not isinstance(sizes, dict):
        return [f"{name}: parameters is not an object"]
    for key, value in sizes.items():
        if key not in known:
            wrong.append(f"{name}: '{key}' is not a parameter; known: {', '.join(known)}")
        elif isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            wrong.append(f"{name}: {key} = {value!r} is not a number")
        elif not known[key]["low"] <= value <= known[key]["high"]:
            low, high, unit = (known[key][part] for part in ("low", "high", "unit"))
            wrong.append(f"{name}: {key} = {value} is out of range, expected {low} to {high} {unit}".rstrip())
    return wrong


def _log_problems(log: Path) -> tuple[list[str], str]:
    """Return what is wrong with a canonical log, and its command as text."""
    where, heading = f"trials/{log.name}", {}
    try:
        lines = log.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        return [f"{where}: cannot be read as UTF-8: {error}"], ""
    while lines and lines[0].startswith("#"):
        key, sign, value = lines.pop(0)[1:].partition("=")
        if sign:
            heading[key.strip()] = value.strip().strip('"')
    wrong = [f"{where}: '# {key} = …' is missing above the header" for key in COMMAND if key not in heading]
    rows = list(csv.reader(lines))
    columns = [name.strip() for name in rows[0]] if rows else []
    short = {
        "_".join(name.split("_")[: 1 if name.startswith("t_") else 2]): k for k, name in enumerate(columns)
    }
    missing = [name for name in NEEDED if name not in short]
    if missing:
        return [*wrong, f"{where}: no column for {', '.join(missing)} (other loggers: add map.toml)"], ""
    last = -math.inf
    for number, row in enumerate(rows[1:], 2):
        try:
            numbers = [float(cell) for cell in row if cell.strip()]
            stamp = float(row[short["t"]])
        except (ValueError, IndexError):
            return [*wrong, f"{where}: row {number} contains a cell that is not a number"], ""
        if len(row) != len(columns) or not all(map(math.isfinite, numbers)) or stamp < last:
            return [*wrong, f"{where}: row {number}: missing or infinite cells, or time runs backwards"], ""
        last = stamp
    if len(rows) < 100:
        wrong.append(f"{where}: only {len(rows)} rows")
    return wrong, " ".join(heading.get(key, "") for key in COMMAND)


def sealed_answer(kit: Path) -> dict[str, Any]:
    """Return what is sealed: the answer, a random salt against guessing, and the hash of every input."""
    answer = json.loads((kit / ANSWER).read_text(encoding="utf-8"))
    allowed = json.loads((kit / ALLOWED).read_text(encoding="utf-8"))["effects"]
    effects = []
    for effect in answer["effects"]:
        known = allowed.get(effect["id"], {"title": "", "parameters": {}})
        sizes = effect.get("parameters", {})
        effects.append({
            "id": effect["id"],
            "title": effect.get("title") or known["title"],
            "account": effect.get("account", ""),
            "library": effect["id"] != OUTSIDE,
            "parameters": {
                key: {"value": value, "unit": known["parameters"][key]["unit"], "kind": "equivalent"}
                for key, value in sizes.items()
                if key in known["parameters"]
            },
        })  # fmt: skip
    inputs = [*logs_of(kit), *sorted((kit / "trials").glob("*.toml"))]
    files = {f"trials/{path.name}": hashlib.sha256(path.read_bytes()).hexdigest() for path in inputs}
    return {
        "schema": "granite-lab/sealed/1",
        "made_by": answer["made_by"],
        "virtual": answer["virtual"],
        "note": str(answer.get("note", "")),
        "salt": secrets.token_hex(16),
        "effects": effects,
        "trials": {Path(name).name: {"file": name, "sha256": digest} for name, digest in files.items()},
    }


def main(arguments: list[str]) -> int:
    """Check the kit that this file lies in; return the exit code."""
    if set(arguments) - {"--seal"}:
        print(__doc__)
        return 2
    kit = Path(__file__).resolve().parent
    wrong, weak = problems(kit)
    for line in weak:
        print(f"warning: {line}")
    for line in wrong:
        print(f"error: {line}")
    if wrong:
        return 3
    print(f"{len(logs_of(kit))} logs and the answer can be used")
    if "--seal" in arguments:
        data = seal(sealed_answer(kit))
        digest = hashlib.sha256(data).hexdigest()
        (kit / SEALED).write_bytes(data)
        (kit / HASH).write_text(f"{digest}  {SEALED}\n", encoding="utf-8")
        print(f"sealed: SHA-256 {digest}")
        print(f"remove {ANSWER} before you send this folder; {SEALED} can follow after the search")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
