"""The views of a servo's position error."""

import numpy as np
import servos

from gms_mujoco.compare import compare
from gms_mujoco.effects import Coulomb, Viscous
from gms_mujoco.plant import Plant
from gms_mujoco.simulate import simulate

SAME = Plant(servos.INERTIA, (servos.LOOP, Coulomb(coulomb=servos.FRICTION), Viscous(coefficient=servos.DAMPING)))


def test_a_servo_that_stays_behind_shows_over_velocity() -> None:
    """What comes T late is behind by T v."""
    t = 0.02 * np.arange(400)
    made = [servos.run(np.sin(2.5 * t + i), gain=24.0, start=np.sin(i), step=0.02, name=str(i)) for i in range(3)]
    runs = [simulate(servos.TRUE, r, position_noise=1e-4, seed=i) for i, r in enumerate(made)]
    c = compare(SAME, runs)
    view = c.view("velocity")
    assert view is not None and view.share > 0.8 and (view.unit, view.value_unit) == ("rad/s", "rad")
    slope = np.polyfit(view.centres, view.mean, 1)[0]
    assert -servos.DELAY * 1.2 < slope < -servos.DELAY * 0.8
    assert {"position", "following_error", "goal_rate", "frequency"} <= {m.name for m in c.views}
    assert c.after_reversal is None and not any(m.name == "torque" for m in c.views)


def test_a_servo_that_is_known_stays_within_its_noise() -> None:
    t = 0.02 * np.arange(400)
    made = [servos.run(np.sin(2.5 * t + i), gain=24.0, start=np.sin(i), step=0.02, name=str(i)) for i in range(3)]
    runs = [simulate(servos.TRUE, r, position_noise=1e-3, seed=i) for i, r in enumerate(made)]
    assert "is at its noise floor" in compare(servos.TRUE, runs).where
