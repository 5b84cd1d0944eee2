"""An effect file as a user would write it."""

EXAMPLE = '''\
"""A wind that blows against the robot."""

from dataclasses import replace

from granite_lab.model.effect import Effect, EffectParameter


class HeadWind(Effect):
    """A constant force on the body, at the height of the centre of mass."""

    id = "head_wind"
    title = "wind against the robot"
    equation = "m a_x = (20) - force"
    source = "a fan in front of the sand box"
    signature = "more slip and current at every speed, and a small creep at rest"
    parameters = (
        # name, unit, meaning, low, high, neutral, expected from, expected to
        EffectParameter("force", "N", "force of the wind", -50.0, 50.0, 0.0, 1.0, 10.0),
    )

    def body_load(self, load, body, axles, p, own):
        return replace(load, x=load.x - own.p["force"])
'''
