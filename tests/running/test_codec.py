"""Records become bytes and come back the same; what is no record is refused."""

from __future__ import annotations

import math
import pickle
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from granite_lab.effects import library
from granite_lab.estimate import Estimate
from granite_lab.files import write_text
from granite_lab.logs.trial import ImuStream, Trial, TrialInfo
from granite_lab.model.effect import activate
from granite_lab.running.cache import content
from granite_lab.running.codec import ALIGNED, decode, encode, sealed
from granite_lab.running.options import Options

plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.lists(inner, max_size=3).map(tuple)
        | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=20,
)


@given(plain)
def test_any_plain_value_comes_back_with_its_types(value: object) -> None:
    assert repr(decode(encode(value))) == repr(value)


def test_a_trial_comes_back_whole() -> None:
    imu = ImuStream(np.array([0.0, 0.1]), np.array([[math.nan, -0.0, 9.81]] * 2), np.zeros((2, 3)), True)
    trial = Trial("a b", TrialInfo(robot="granite", extra={"sand": "düne"}), imu=imu, warnings=("w",))
    back = decode(encode(trial))
    assert (back.name, back.info, back.warnings, back.wheels) == (trial.name, trial.info, ("w",), None)
    assert back.imu.specific_force.tobytes() == imu.specific_force.tobytes()
    assert back.imu.gravity_removed is True


def test_equal_records_have_equal_hashes() -> None:
    options = Options(robot="granite", model=Path("m.toml"), distance_measured=Estimate(2.0, math.inf))
    assert content(options) == content(Options(**vars(options)))
    assert content(options) != content(Options(**vars(options) | {"rows": "x"}))
    assert content({"x": np.arange(5000)}) != content({"x": np.arange(5000) % 4000})
    assert decode(encode(options)) == options


def test_an_effect_comes_back_as_the_one_of_the_library() -> None:
    effect = library()["tyre_windup"]
    active = activate(effect, {effect.parameters[0].name: effect.parameters[0].prior_high})
    assert decode(encode((active,)), library()) == (active,)
    with pytest.raises(KeyError):
        decode(encode(active), {})


@dataclass
class Stranger:
    x: int = 1


@pytest.mark.parametrize("value", [Stranger(), object(), np.array([{}])[0:0].flat])
def test_what_is_no_record_of_the_package_is_refused(value: object) -> None:
    with pytest.raises(TypeError):
        encode((value,))


def test_bytes_name_no_code_outside_the_package() -> None:
    class Call:
        def __reduce__(self) -> object:
            return Path.touch, (Path("x"),)

    for data in (pickle.dumps(Call()), pickle.dumps(Fraction(1, 2)), pickle.dumps(write_text)):
        sizes = np.array([1, len(data)], "<i8").tobytes()
        with pytest.raises(ValueError, match="no record"):
            decode(sealed(sizes.ljust(ALIGNED, b"\0") + data))
    with pytest.raises(ValueError, match="not whole"):
        decode(pickle.dumps(1))


@pytest.mark.parametrize("shape", [(), (0,), (3, 0), (2, 3)])
@pytest.mark.parametrize("kind", ["<f8", "|b1", "<U3", "<i2"])
def test_arrays_of_any_shape_and_kind_come_back_as_they_were(shape: tuple[int, ...], kind: str) -> None:
    array = np.ones(shape, kind)
    back = decode(encode([array, array]))
    assert [(b.dtype, b.shape, b.tobytes()) for b in back] == 2 * [(array.dtype, shape, array.tobytes())]
    assert all(b.flags.aligned and b.flags.writeable for b in back)
