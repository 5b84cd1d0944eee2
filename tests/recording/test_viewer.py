"""Opening the viewer, and a look through it where a graphics driver is present."""

import io
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from granite_lab.errors import InputError, LabError
from granite_lab.reporting.recording import (
    open_viewer,
    record_trial,
    viewer,
)
from tests.reporting.made_up import made_up_trial
from tests.reporting.made_up_finding import made_up_finding

ARTEFACTS = Path(__file__).parent.parent / "artefacts"
CAN_DRAW = any(Path("/usr/share/vulkan/icd.d").glob("*.json"))
draws = pytest.mark.skipif(not CAN_DRAW, reason="no Vulkan driver to draw with")
SAND, PAINT, MAGENTA = (214, 184, 132), (52, 120, 178), (240, 90, 200)


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    path = tmp_path / "a.rrd"
    path.write_bytes(b"RRF2 and more")
    return path


def test_what_is_no_recording_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.rrd").write_text("t_s,imu_ax_mps2\n")
    for name, said in (("no_such.rrd", "no_such"), ("a.rrd", "not a Rerun recording")):
        with pytest.raises(InputError, match=said):
            open_viewer([tmp_path / name])


def test_no_display_is_said_with_a_way_out(recorded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(LabError, match="no display") as caught:
        open_viewer([recorded])
    assert str(recorded.resolve()) in caught.value.hint
    assert "rerun --bind 127.0.0.1 --serve-web" in caught.value.hint


def test_a_viewer_that_dies_at_once_is_reported(recorded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[subprocess.Popen[bytes]] = []

    def pretend(code: str) -> None:
        def start(*_: object, **__: object) -> subprocess.Popen[bytes]:
            started.append(subprocess.Popen([sys.executable, "-c", code]))
            return started[-1]

        monkeypatch.setattr(viewer, "_start", start)

    monkeypatch.setenv("DISPLAY", ":0")
    pretend("raise SystemExit(102)")
    with pytest.raises(LabError, match="code 102"):
        open_viewer([recorded])
    monkeypatch.setattr(viewer, "PATIENCE", 0.3)
    pretend("import time; time.sleep(30)")
    open_viewer([recorded])
    assert started[1].poll() is None
    started[1].kill()
    started[1].wait()


@pytest.fixture
def headless() -> Iterator[Any]:
    """A viewer without a window, drawing by whatever Vulkan driver there is."""
    import rerun_cli
    from rerun.experimental import ViewerClient

    binary = Path(rerun_cli.__file__).parent / "rerun"
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    with ViewerClient.spawn(
        headless=True, port=port, hide_welcome_screen=True, executable_path=str(binary)
    ) as client:
        yield client


def _shown(client: Any, path: Path, t: float) -> dict[str, Any]:
    """Open a recording at a time and return the views by name; none of them has anything to report."""
    client.open(str(path.resolve()))
    end = time.monotonic() + 20
    while not client.get_state().views and time.monotonic() < end:
        time.sleep(0.2)
    client.set_time("time", duration=t, play_state="paused")
    time.sleep(2)
    views = client.get_state().views
    assert [(view.name, view.reports) for view in views if view.reports] == []
    return {view.name: view for view in views}


def _picture(png: bytes, keep_as: str) -> np.ndarray:
    ARTEFACTS.mkdir(exist_ok=True)
    (ARTEFACTS / f"{keep_as}.png").write_bytes(png)
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), float)


def _share(picture: np.ndarray, colour: tuple[int, int, int]) -> float:
    """Share of the pixels that have this hue, whatever the light makes of their brightness."""
    target = np.array(colour) / np.linalg.norm(colour)
    bright = np.linalg.norm(picture, axis=2)
    cosine = (picture @ target) / np.maximum(bright, 1)
    return float(((cosine > 0.995) & (bright > 60)).mean())


@draws
def test_a_discovery_is_seen_as_bars(headless: Any, tmp_path: Path) -> None:
    result = made_up_trial(0.3)
    path = record_trial(result, tmp_path / "a.rrd", finding=made_up_finding())
    views = _shown(headless, path, 1.0)
    assert {"Pitch rate [°/s]", "Rear motor current [A]"} <= set(views)
    _picture(headless.take_screenshot(), "recording_discovery")
    bars = next(view for name, view in views.items() if name.startswith("Phases"))
    assert _share(_picture(headless.take_screenshot(bars.view_id), "recording_bars"), (213, 94, 0)) > 0.002


@draws
def test_the_robot_drives_as_time_goes_on(headless: Any, tmp_path: Path) -> None:
    result = made_up_trial(0.3)
    path = record_trial(result, tmp_path / "a.rrd")
    pictures = []
    for t in (0.0, 4.0):
        assert _shown(headless, path, t)
        pictures.append(_picture(headless.take_screenshot(), f"recording_at_{t:g}_s"))
    early, late = pictures
    height, width, _ = early.shape
    robot = (slice(height // 10, height // 3), slice(0, width // 3))
    assert np.abs(early[robot] - late[robot]).mean() > 1  # it has moved on
    for picture in pictures:
        assert _share(picture, SAND) > 0.01
        assert _share(picture, PAINT) > 0.005
        assert _share(picture, MAGENTA) > 1e-4


@draws
def test_a_name_without_glyphs_is_drawn(headless: Any, tmp_path: Path) -> None:
    odd = made_up_trial(0.7, name="砂 \N{LARGE BLUE SQUARE} grüße λ_R² ∂x")
    path = record_trial(odd, tmp_path / "odd.rrd")
    assert _shown(headless, path, 2.0)
    picture = _picture(headless.take_screenshot(), "recording_odd_name")
    assert _share(picture, (86, 180, 233)) > 1e-4
    assert _share(picture, (230, 159, 0)) > 1e-4
