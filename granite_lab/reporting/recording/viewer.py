"""Recordings in the Rerun viewer: in a window, in a browser, or as a picture."""

from __future__ import annotations

import io
import os
import shlex
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from granite_lab.errors import InputError, LabError, UsageError
from granite_lab.files import readable, refuse_special, write_bytes
from granite_lab.reporting.recording.stream import TIMELINE

PATIENCE, START = 4.0, 30.0
"""Time within which a viewer that cannot start ends, and within which a picture stands still [s]."""
SIZE, TITLE_BAR = (1920, 1080), 37
"""Size of a picture's window, and the height of its title bar, which is cut off [pixels]."""
WEB_PORT, DATA_PORT = 9090, 9876
"""Where Rerun serves a page and its data unless the ports are taken."""


def open_viewer(path: Path) -> None:
    """Open a recording in a viewer window of its own and return while it stays open.

    Raises:
        InputError: there is no such file, or it is no recording.
        LabError: this machine has no display, no viewer, or no graphics driver.
    """
    _refuse_others(path)
    elsewhere = (
        f"see it in a browser with 'granite-lab view {shlex.quote(str(path.resolve()))} --web', "
        "or copy that file to a computer with a screen and open it with 'rerun FILE'"
    )
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform.startswith("linux") and not display:
        raise LabError("there is no display to open the Rerun viewer on", elsewhere)
    viewer = _start(["--new", str(path.resolve())], start_new_session=True)
    try:
        code = viewer.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        return
    if code:
        raise LabError(f"the Rerun viewer ended at once with code {code}", elsewhere)


def serve(path: Path, tell: Callable[[str], None]) -> None:
    """Serve a recording and the web viewer on this machine until interrupted.

    Args:
        path: of the recording.
        tell: called with the address once a browser can open it.

    Raises:
        InputError: there is no such file, or it is no recording.
        LabError: there is no viewer, or it ended.
    """
    _refuse_others(path)
    web, data = _free_port(WEB_PORT), _free_port(DATA_PORT)
    alone = threading.current_thread() is threading.main_thread()  # signals are its own
    before = signal.signal(signal.SIGTERM, signal.default_int_handler) if alone else None
    try:
        with _running(["--serve-web", "--port", str(data), "--web-viewer-port", str(web)], path) as server:
            _wait_for(server, lambda: _listens(web) and _listens(data))
            tell(f"http://127.0.0.1:{web}?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{data}%2Fproxy")
            code = server.wait()
    except KeyboardInterrupt:
        return
    finally:
        if alone:
            signal.signal(signal.SIGTERM, before)
    raise LabError(f"the Rerun server ended with code {code}", "start it again")


def save_picture(path: Path, picture: Path, at: float | None = None) -> Path:
    """Save a picture of the viewer with a recording; no display is needed.

    Args:
        path: of the recording.
        picture: of the .png file.
        at: time since the start of the command [s]; without it the middle of the recording.

    Returns:
        `picture`.

    Raises:
        UsageError: the picture is no .png file, or the recording has no such time.
        InputError: there is no such recording.
        LabError: there is no viewer or no graphics driver, or the picture cannot be written.
    """
    from matplotlib.image import imread, imsave  # noqa: PLC0415, heavy
    from rerun.experimental import ViewerClient  # noqa: PLC0415, heavy

    _refuse_others(path)
    if picture.suffix.lower() != ".png":
        raise UsageError(f"{picture}: a picture is a .png file", f"name it {picture.stem}.png")
    port = _free_port(0)
    options = ["--headless", "--port", str(port), "--window-size", f"{SIZE[0]}x{SIZE[1]}"]
    with _running([*options, "--hide-welcome-screen"], path) as viewer:
        client = _wait_for(viewer, lambda: ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy"))
        low, high = _wait_for(viewer, lambda: _extent(client))
        at = (low + high) / 2 if at is None else at
        if not low <= at <= high:
            hint = f"the recording holds {low:.2f} s to {high:.2f} s"
            raise UsageError(f"{path}: there is nothing at {at:g} s", hint)
        client.set_time(TIMELINE, duration=at, play_state="paused")
        png = _wait_for(viewer, lambda: _still(client))
    cropped = io.BytesIO()
    imsave(cropped, imread(io.BytesIO(png))[TITLE_BAR:], format="png")
    write_bytes(picture, cropped.getvalue())
    return picture


def _extent(client: Any) -> tuple[float, float] | None:
    """Return the first and the last time [s] of the recording once it is shown, None before."""
    state = client.get_state()
    timelines = [t for r in state.recordings for t in r.timelines if t.name == TIMELINE]
    ready = state.views and not state.loading and timelines
    return (timelines[0].start / 1e9, timelines[0].end / 1e9) if ready else None


def _still(client: Any) -> bytes | None:
    """Return a picture if it stands still, None while the viewer still draws."""
    before = client.take_screenshot()
    time.sleep(0.5)
    after: bytes = client.take_screenshot()
    return after if after == before else None


def _refuse_others(path: Path) -> None:
    """Raise InputError where there is no such file, or where it is no recording."""
    refuse_special(path)
    try:
        with path.open("rb") as file:
            known = file.read(3) == b"RRF"
    except OSError as error:
        raise readable(error, path) from None
    if not known:
        hint = "make one with 'granite-lab study TRIALS --out DIR'"
        raise InputError(f"{path}: not a Rerun recording", hint)


def _start(options: list[str], **how: Any) -> subprocess.Popen[bytes]:
    """Start the viewer that comes with the rerun-sdk package, bound to this machine only."""
    import rerun_cli  # type: ignore[import-untyped]  # noqa: PLC0415, heavy

    # The program itself: the Python process that 'python -m rerun' puts around it would end without it.
    folder = Path(rerun_cli.__file__).parent
    places = [folder / name for name in ("Rerun.app/Contents/MacOS/Rerun", "rerun.exe", "rerun")]
    binary = next((place for place in places if place.exists()), places[-1])
    quiet: dict[str, Any] = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    try:
        return subprocess.Popen([binary, "--bind", "127.0.0.1", *options], **quiet, **how)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        hint = "install it again with 'pip install --force-reinstall rerun-sdk'"
        raise LabError(f"the Rerun viewer cannot be started: {reason}", hint) from None


@contextmanager
def _running(options: list[str], path: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run a viewer with a recording for as long as it is needed."""
    process = _start([*options, str(path.resolve())])
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


def _wait_for(viewer: subprocess.Popen[bytes], ask: Callable[[], Any]) -> Any:
    """Return the first answer that is not empty; raise LabError where the viewer ends or takes too long."""
    end = time.monotonic() + START
    while time.monotonic() < end:
        if viewer.poll() is not None:
            hint = "try again; a picture needs a Vulkan driver, such as that of mesa-vulkan-drivers"
            raise LabError(f"the Rerun viewer ended at once with code {viewer.returncode}", hint)
        try:
            if answer := ask():
                return answer
        except ConnectionError:
            pass  # it has not started yet
        time.sleep(0.1)
    raise LabError(f"the Rerun viewer did not answer within {START:g} s", "try again")


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def _free_port(wanted: int) -> int:
    """Return the wanted port of this machine, or another one where that is taken."""
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", wanted))
        except OSError:
            probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
