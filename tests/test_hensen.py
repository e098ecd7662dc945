"""LuGre by Hensen's route, against LuGre of MuJoCo's own dcmotor, which shares no code with it."""

import mujoco
import numpy as np
import pytest

from gms_mujoco.errors import DataError
from gms_mujoco.excitation import Excitation
from gms_mujoco.frf import FRF, estimate_frf, join_sines
from gms_mujoco.hensen import constant_velocity, fit_sliding, identify_lugre
from gms_mujoco.record import Record

J, SIGMA0, SIGMA1, FC, FS, VS, SIGMA2, H = 2.4e-5, 1.5, 4e-4, 4e-3, 5e-3, 0.8, 2e-5, 5e-4
SUBSTEPS = 20
SEEN = SIGMA1 - SIGMA0 * H / SUBSTEPS  # dcmotor's force acts a time step late, which takes that much off its damping
XML = f"""<mujoco><option timestep="{H / SUBSTEPS}" gravity="0 0 0"/>
<worldbody><body><joint name="shaft" axis="0 0 1" damping="{SIGMA2}"/>
<inertial pos="0 0 0" mass="1" diaginertia="{J} {J} {J}"/></body></worldbody>
<actuator><motor joint="shaft"/><dcmotor joint="shaft" input="none" motorconst="0" resistance="1"
lugre="{SIGMA0} {SIGMA1} {FC} {FS} {VS}"/></actuator></mujoco>"""
MODEL = mujoco.MjModel.from_xml_string(XML)


def bench(command, n: int) -> Record:
    """`command(k, position, velocity)` is held for each sample."""
    data = mujoco.MjData(MODEL)
    torque, position = np.empty(n), np.empty(n)
    for k in range(n):
        position[k] = data.qpos[0] - H / SUBSTEPS / 2 * data.qvel[0]
        data.ctrl[0] = torque[k] = command(k, data.qpos[0], data.qvel[0])
        mujoco.mj_step(MODEL, data, SUBSTEPS)
    return Record("dcmotor", H * np.arange(n), {"torque": torque, "position": position})


@pytest.fixture(scope="module")
def responses() -> list[FRF]:
    points = []
    for f in np.geomspace(12, 200, 9):
        sine = Excitation.sine(H, f, 2e-5)
        signal = sine.repeat(4, 1.5)
        record = bench(lambda k, q, v, s=signal: s[k], len(signal))
        points.append(estimate_frf(record, period=sine.period, transient=2))
    return join_sines(points)


@pytest.fixture(scope="module")
def sliding() -> tuple[np.ndarray, np.ndarray]:
    speeds = (0.1, -0.3, 0.5, 0.7, 1.0, -1.5, 3.0, 6.0)
    runs = [bench(lambda k, q, v, w=w: 0.3 * (w * k * H - q) + 4e-3 * (w - v), 1200) for w in speeds]
    return constant_velocity(runs)


def test_the_parameters_of_a_dcmotor_come_back(responses, sliding) -> None:
    found = identify_lugre(responses, *sliding)
    lugre, viscous = found.plant["lugre"], found.plant["viscous"]
    assert found.plant.inertia == pytest.approx(J, rel=2e-3)
    assert lugre.stiffness == pytest.approx(SIGMA0, rel=2e-3)
    assert lugre.damping == pytest.approx(SEEN, rel=0.01)
    assert (lugre.coulomb, lugre.static) == (pytest.approx(FC, rel=0.01), pytest.approx(FS, rel=0.02))
    assert lugre.stribeck_velocity == pytest.approx(VS, rel=0.05)
    assert viscous.coefficient == pytest.approx(SIGMA2, rel=0.1)
    low, high = found.plant.uncertainty["lugre.stiffness"]
    assert low < lugre.stiffness < high and "bristle breaks away" in found.status


def test_the_lag_of_first_order_is_taken_off(responses, sliding) -> None:
    """Without it the damping would take the loss of the bristle's hysteresis."""
    frf = responses[0]
    with_lag = identify_lugre([frf], *sliding, J).plant["lugre"].damping
    plain = float(np.median((1 / frf.response).imag / frf.omega)) - SIGMA2
    assert abs(with_lag - SEEN) < 0.2 * abs(plain - SEEN)


def test_the_sliding_curve_of_points_on_it() -> None:
    v = np.array([-4.0, -1.0, -0.3, 0.1, 0.5, 2.0, 8.0])
    truth = np.sign(v) * (FC + (FS - FC) * np.exp(-((v / VS) ** 2)) + SIGMA2 * np.abs(v))
    curve = fit_sliding(v, truth)
    assert np.allclose(curve.torque(v), truth, rtol=1e-4) and curve.error < 1e-4
    assert (curve.coulomb, curve.static, curve.viscous) == tuple(
        pytest.approx(x, rel=2e-3) for x in (FC, FS, SIGMA2)
    )


def test_data_that_cannot_tell_are_refused(responses, sliding) -> None:
    v, f = sliding
    frf = responses[0]
    large = FRF("large", frf.frequency, frf.response, amplitude=np.full(len(frf), 0.1))
    mass = FRF("mass", frf.frequency, -1 / (J * frf.omega**2) + 0j, excitation=1e-6)
    for frfs, speeds, torques, words in (
        ([], v, f, "no frequency responses"),
        ([large], v, f, "not small against the break-away"),
        ([mass], v, f, "no frictional resonance|not small"),
        (responses, v[:3], f[:3], "at least 4"),
        (responses, v, f[:3], "one torque for each"),
        (responses, v, -f, "does not oppose"),
        (responses, v, np.append(f[:-1], np.nan), "must be finite numbers"),
        (responses, "fast", f, "must be numbers"),
    ):
        with pytest.raises(DataError, match=words):
            identify_lugre(frfs, speeds, torques)
