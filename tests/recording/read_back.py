"""Reading a recording back with rerun's own reader."""

import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import RrdReader


class ReadBack:
    """All rows of a recording, by entity and component."""

    def __init__(self, path: Path) -> None:
        self.reader = RrdReader(path)
        self.schema = self.reader.store().schema()
        self.batches: dict[str, list[Any]] = defaultdict(list)
        self.static: dict[str, list[Any]] = defaultdict(list)
        for chunk in self.reader.stream():
            where = self.static if chunk.is_static else self.batches
            where[str(chunk.entity_path)].append(chunk.to_record_batch())

    def entities(self) -> set[str]:
        return set(self.batches) | set(self.static)

    def t(self, entity: str) -> np.ndarray:
        """Times of an entity's rows [s]."""
        columns = [b.column("time").cast("int64").to_numpy() for b in self.batches[entity]]
        return np.concatenate(columns) / 1e9

    def values(self, entity: str, component: str) -> np.ndarray:
        """Values of an entity's rows, instances and vectors flattened into one axis behind the rows."""
        rows = [row for b in self.batches[entity] for row in b.column(component).to_pylist()]
        return np.array(rows)

    def scalars(self, entity: str) -> np.ndarray:
        """Samples (N,) or, of several lines, (N, K), in the unit of the plot."""
        dots = "Scalars:scalars" in self.batches[entity][0].schema.names
        values = self.values(entity, "Scalars:scalars" if dots else "Measurements:values").astype(float)
        return values[:, 0] if values.shape[1] == 1 else values

    def texts(self, entity: str, component: str) -> list[str]:
        return [str(row[0]) for row in self.values(entity, component)]

    def fixed(self, entity: str, component: str) -> list[Any]:
        """What was logged for all times."""
        for batch in self.static[entity]:
            if component in batch.schema.names:
                return list(batch.column(component).to_pylist()[0])
        raise KeyError(f"{entity} has no static {component}")


def verify(*paths: Path) -> str:
    """Return what rerun's own verifier says; it returns 0 even on a file that is no recording."""
    command = [sys.executable, "-m", "rerun", "rrd", "verify", *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr
