"""Checks of a log by itself: units, stuck channels, speeds that lag, commanded angles."""

import numpy as np

from stiction_envs.arrays import Array, Index
from stiction_envs.errors import StictionError
from stiction_envs.filters import lowpass, spectrum
from stiction_envs.measured.logs.corrections import RawLog, longest_run
from stiction_envs.measured.motion_thresholds import MOVER_RATIO, REVERSAL_SPEED, STIR_SPAN
from stiction_envs.robots.arm_toml import Limits

LARGEST = {
    **dict.fromkeys(("q", "q_cmd"), (1e3, "rad")),
    "dq": (1e3, "rad/s"),
    **dict.fromkeys(("tau", "tau_cmd"), (1e5, "N·m")),
}
"""Values with their units that no joint of an arm comes near; assumed."""
FREE_ANGLE = 20.0
"""Largest angle that passes for radians where the robot's limits are not known [rad]; assumed."""
SLOWEST_STEP = 0.1  # time between rows above which a log does not show friction [s]; assumed
SATURATED_ROWS = 5  # this many rows in a row at a channel's largest value are a limit; assumed
COARSE_LEVELS = 10  # a torque of fewer levels is a coarse sensor at rest [-]; assumed
NEAR_ZERO = 0.02  # values without a sign come down to this share of the largest [-]; assumed
COMPARED_SECONDS = 60.0  # length of the stretch in which speed and angle are compared [s]; assumed
COMPARED_ROWS = 64  # fewest rows in which speeds are compared; assumed
COMPARED_HZ = 2.0  # below this frequency arms move, and speeds are compared [Hz]; assumed
FASTEST = 20.0
"""No joint of an arm moves faster, whatever its limits say [rad/s]; assumed: hobby servos do 10."""
TOO_FAST = 3.0  # no arm moves at more than this times its joint's largest speed [-]; assumed
_DEGREE = np.pi / 180


def check_finite(rows: RawLog) -> None:
    """Raise a StictionError at the first infinite or too large value, or row without time."""
    if not np.isfinite(rows.t).all():
        i = int(np.argmin(np.isfinite(rows.t)))
        raise StictionError(f"{rows.place(i)}: t is {rows.t[i]}: expected finite numbers in s")
    for name, array in rows.data.items():
        most, unit = LARGEST.get(name, (np.finfo(float).max, ""))
        # NaN is a missing value and not an error here.
        bad = np.abs(array) > most
        if bad.any():
            i, j = (int(k) for k in np.argwhere(bad)[0])
            value = array[i, j]
            may = f"up to {most:g} {unit}" if np.isfinite(value) and unit else "finite numbers"
            if name in ("q", "q_cmd") and np.isfinite(value):
                may += ", or units ticks (encoder steps)"
            raise StictionError(f"{rows.place(i)}: {name}{j + 1} is {value:g}: expected {may}")


def check_time(rows: RawLog) -> None:
    """Raise a StictionError at the first row where time falls, or for a unit other than s."""
    step = np.diff(rows.t)
    fell = (step < 0) & (rows.run[1:] == rows.run[:-1])
    if fell.any():
        i = int(np.argmax(fell))
        raise StictionError(
            f"{rows.place(i + 1)}: t falls from {rows.t[i]:.9g} to {rows.t[i + 1]:.9g}: expected "
            "time that rises (a column run may start it anew)"
        )
    rising = step[step > 0]
    if not len(rising):
        raise StictionError(f"{rows.place(0)}: t never rises: expected time in s")
    usual = float(np.median(rising))
    if usual > SLOWEST_STEP:
        units = ("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)
        likely = [u for u, scale in units if usual / scale < SLOWEST_STEP]
        hint = f", it looks like {likely[0]}" if usual > 0.5 and likely else ""
        raise StictionError(
            f"{rows.place(0)}: t rises by {usual:g} from row to row{hint}: expected time in s "
            f"(else its unit in the header, as t [ms]), {1 / SLOWEST_STEP:g} rows a second or more"
        )


def check_angles(rows: RawLog, limits: Limits | None, channel: str = "q") -> list[str]:
    """Return warnings about angles beyond the joint ``limits`` that no unit explains.

    Raises:
        StictionError: angles look like degrees.
    """
    warnings = []
    unlimited = None if limits is None else limits.assumed("position")
    why = "another robot, zero or sign, or other limits than its file's ([limits.position])?"
    if channel != "q":
        why = "the servo may cut it"
    for j, q in enumerate(rows.data[channel].T):
        low, high = (0.0, 0.0) if limits is None else limits.position[j]
        i = int(np.argmax(np.abs(q)))
        if unlimited is not None and unlimited[j]:
            if abs(q[i]) > FREE_ANGLE:
                warnings.append(
                    f"{channel}{j + 1} reaches {q[i]:.4g} rad, and the joint has no limits: in "
                    "degrees? units deg"
                )
            continue
        # an angle within a turn may be right, and the limits wrong
        if abs(q[i]) > max(FREE_ANGLE if limits is None else 2 * np.pi, -2 * low, 2 * high):
            raise StictionError(
                f"{rows.place(i)}: {channel}{j + 1} is {q[i]:g}, which looks like degrees: "
                "expected "
                + ("radians" if limits is None else f"{low:g} to {high:g} rad")
                + ", or units deg (percent, ticks)"
            )
        beyond = (
            x
            for x in (q.min(), q.max())
            if not low - 0.05 * abs(low) <= x <= high + 0.05 * abs(high)
        )
        end = None if limits is None else next(beyond, None)
        if end is not None:
            warnings.append(
                f"{channel}{j + 1} reaches {end:.3g} rad, beyond the joint's limits of {low:g} to "
                f"{high:g} rad: {why}"
            )
    return warnings


def check_units(rows: RawLog, limits: Limits | None) -> list[str]:
    """Return warnings about angles and torques beyond the ``limits`` that no unit explains.

    Raises:
        StictionError: q looks like degrees, or tau like percent or mN·m.
    """
    warnings = check_angles(rows, limits)
    if limits is None:
        return warnings
    doubtful = limits.doubtful("torque")
    for j, tau in enumerate(rows.data["tau"].T):
        most, size = float(limits.torque[j]), np.abs(tau)
        usual, largest = float(np.percentile(size, 90)), np.max(size)
        other = bool(usual > most or largest > 3 * most)
        suspect = _limit(limits, "torque", j, "N·m")
        if other and not doubtful[j]:
            # mN·m are a thousand times too large, per cent at most some hundreds.
            unit = "mN·m" if usual > 300 else "per cent of the rated torque"
            i = int(np.argmax(size))
            raise StictionError(
                f"{rows.place(i)}: tau{j + 1} is {tau[i]:g}, which looks like {unit}: expected "
                f"N·m, and this joint can do {suspect}"
            )
        if largest > 1.2 * most:
            unit = "; or in another unit than N·m?" * other
            warnings.append(
                f"tau{j + 1} reaches {largest:.4g} N·m, the joint can do {suspect}{unit}"
            )
    return warnings


def _limit(limits: Limits, name: str, j: int, unit: str) -> str:
    """Return a joint's limit with its origin, and how to state the true one."""
    assumed = limits.assumed(name)[j]
    origin = "assumed, the robot's file states none" if assumed else "stated by the robot's file"
    text = f"{getattr(limits, name)[j]:g} {unit} ({origin}; a TOML beside it corrects it"
    return f"{text}: [limits.{name}])"


def check_channels(rows: RawLog) -> list[str]:
    """Return warnings about channels that never change or stay at a limit.

    Raises:
        StictionError: no torque, or neither angle nor torque, ever changes.
    """
    warnings = []
    span = {name: np.ptp(rows.data[name], axis=0) for name in rows.core()}
    still = {name: span[name] == 0 for name in span}
    n = len(still["q"])
    if still["tau"].all():
        what = f"tau1..tau{n}"
        if still["q"].all():
            what = f"q1..q{n} and {what}"
        raise StictionError(f"{rows.place(0)}: {what} never change: expected a measurement")
    if still["q"].all():
        warnings.append("no q ever changes: the arm rests, or its positions were not logged")
    for name in (name for name in still if name != "q"):
        for j in np.flatnonzero(still[name] & (span["q"] > STIR_SPAN)):
            value = f"{name}{j + 1} is always {rows.data[name][0, j]:.4g}"
            warnings.append(f"{value} although the joint moves")
    return warnings + check_torques(rows)


def check_torques(rows: RawLog) -> list[str]:
    """Return warnings about torques that stay at a limit, or have no sign."""
    tau = rows.data["tau"]
    unsigned = is_unsigned(tau)
    warnings = []
    if unsigned:
        warnings.append(
            f"tau1..tau{tau.shape[1]} are never negative: sizes without sign (of currents?), not "
            "torques; a column current_abs1..n beside q_cmd1..n is for them"
        )
    for joint, of in enumerate(tau.T, 1):
        warnings += _saturation(f"tau{joint}", of, least=not unsigned)
    return warnings


def is_unsigned(tau: Array) -> bool:
    """Return whether values (T, n) are sizes: none is negative, and most joints' come near zero."""
    low, high = tau.min(axis=0), tau.max(axis=0)
    near = (low <= NEAR_ZERO * high)[high > 0]
    return bool((low >= 0).all() and len(near) and near.mean() > 0.5)


def _saturation(column: str, x: Array, *, least: bool = True) -> list[str]:
    """Return warnings about a value's largest and, if ``least``, smallest value."""
    if len(np.unique(x)) < COARSE_LEVELS:
        return []
    ends = {"largest": x == x.max(), "smallest": x == x.min()}
    if not least:
        del ends["smallest"]
    # A quantised signal stays at its extremes too, but no longer than anywhere else.
    between = (x != x.max()) & (x != x.min())
    usual = longest_run(np.r_[False, (np.diff(x) == 0) & between[1:]])
    return [
        f"{column} stays at its {what} value {x[np.argmax(at)]:.5g} N·m in {at.sum()} rows, "
        f"up to {longest_run(at)} in a row: saturated"
        for what, at in ends.items()
        if longest_run(at) >= max(SATURATED_ROWS, 2 * usual)
    ]


def check_pace(rows: RawLog, step: float, limits: Limits | None) -> list[str]:
    """Return warnings about joints of a log without gaps that move faster than a doubtful limit.

    Raises:
        StictionError: a joint moves several times faster than it can: its angles look like degrees.
    """
    t = np.arange(rows.t[0], rows.t[-1], step)
    warnings: list[str] = []
    if limits is None or len(t) < COMPARED_ROWS:
        return warnings
    doubtful = limits.doubtful("velocity")
    cutoff = min(COMPARED_HZ, 0.2 / step)
    for j, x in enumerate(rows.data["q"].T):
        speed = np.abs(np.gradient(lowpass(np.interp(t, rows.t, x), 1 / step, cutoff), step)).max()
        if speed > TOO_FAST * limits.velocity[j]:
            text = f"q{j + 1} moves at {speed:.3g} rad/s, the joint can do "
            text += _limit(limits, "velocity", j, "rad/s")
            if not doubtful[j] or speed > FASTEST:
                raise StictionError(
                    f"{text}, which looks like degrees: expected rad, or units deg (percent, "
                    "ticks), and time in s"
                )
            warnings.append(f"{text}; or angles in degrees, or time not in s?")
    return warnings


def check_speeds(rows: RawLog, step: float) -> list[str]:
    """Return warnings about dq against the derivative of q: unit, sign, lag.

    Scale s and lag δ by least squares, dq(t) ≈ s·(q̇(t) − δ·q̈(t)), below `COMPARED_HZ`, of a log
    without repeats and gaps, whose rows are ``step`` [s] apart.

    Raises:
        StictionError: dq is in degrees per second.
    """
    if "dq" not in rows.data or rows.t[-1] - rows.t[0] < 2 / COMPARED_HZ:
        return []
    t, rate = np.arange(rows.t[0], min(rows.t[-1], rows.t[0] + COMPARED_SECONDS), step), 1 / step
    grid = {
        name: np.stack([np.interp(t, rows.t, x) for x in rows.data[name].T], axis=1)
        for name in rows.core()
    }
    if len(grid["q"]) < COMPARED_ROWS:
        return []
    speeds = np.gradient(grid["q"], step, axis=0)
    size = speeds.std(axis=0)
    # Joints that are only shaken by others are poor evidence, and have a lag of their own.
    movers = np.flatnonzero((size > MOVER_RATIO * size.max()) & (size > REVERSAL_SPEED))
    cutoff = min(COMPARED_HZ, 0.2 * rate)
    found, end = [], int(rate / cutoff / 2)
    for j in movers:
        # the filter continues the ends without a lag
        v, dq = (lowpass(x[:, j], rate, cutoff)[end:-end] for x in (speeds, grid["dq"]))
        both = np.stack([v, np.gradient(v, step)], axis=1)
        (scale, turned), *_ = np.linalg.lstsq(both, dq, rcond=None)
        left = dq - both @ (scale, turned)
        if scale and left.var() < 0.1 * dq.var():
            found.append((scale, -turned / scale))
    warnings = _speed_findings(np.array(found), step) if found else []
    return warnings + (_commanded_angles(grid, rate, movers) if "tau" in grid else [])


def _speed_findings(found: Array, step: float) -> list[str]:
    warnings = []
    scale, lag = (float(x) for x in np.median(found, axis=0))
    if abs(abs(scale) * _DEGREE - 1) < 0.2:
        raise StictionError(
            f"dq is {abs(scale):.3g} times the derivative of q, which looks like degrees per "
            "second: expected rad and rad/s"
        )
    if scale < 0:
        warnings.append("dq has the opposite sign of the derivative of q")
    elif abs(scale - 1) > 0.1:
        warnings.append(f"dq is {scale:.3g} times the derivative of q")
    spread = float(np.median(np.abs(found[:, 1] - lag)))
    if abs(lag) > max(0.75 * step, 3 * spread):
        side = "lags" if lag > 0 else "leads"
        text = f"dq {side} the derivative of q by {1e3 * abs(lag):.3g} ms"
        warnings.append(f"{text}: speeds are taken from q")
    return warnings


def _commanded_angles(grid: dict[str, Array], rate: float, movers: Index) -> list[str]:
    """Warn where q lacks a vibration that dq and tau show: then q is not what was measured."""
    found: dict[tuple[float, float], list[tuple[float, float, float]]] = {}
    for j in movers:
        v = np.gradient(grid["q"][:, j], 1 / rate)
        dq, tau = grid["dq"][:, j], grid["tau"][:, j]
        f, p_v, p_dq, _ = _spectra(v, dq, rate)
        with_dq, with_v = _spectra(dq, tau, rate)[3], _spectra(v, tau, rate)[3]
        low = 2.0
        while 2 * low <= 0.3 * rate:
            band = (f >= low) & (f < 2 * low)
            if not band.any():
                break
            ratio = float(np.sqrt(np.median(p_dq[band]) / max(np.median(p_v[band]), 1e-300)))
            a, b = float(np.mean(with_dq[band])), float(np.mean(with_v[band]))
            if ratio > 3 and a > 0.2 and b < 0.25 * a:
                found.setdefault((low, 2 * low), []).append((ratio, a, b))
            low *= 2
    if not found:
        return []
    (low, high), most = max(found.items(), key=lambda item: sum(a for _, a, _ in item[1]))
    if 2 * len(most) <= len(movers):
        return []
    ratio, a, b = np.median(most, axis=0)
    return [
        f"q may be the commanded position and not the measured one: at {low:g} to {high:g} Hz dq "
        f"shakes with tau (coherence {a:.2f}), but the derivative of q is {ratio:.0f} times "
        f"smaller and does not (coherence {b:.2f})"
    ]


def _spectra(x: Array, y: Array, rate: float) -> tuple[Array, ...]:
    """Return frequencies [Hz], spectra of x and of y, and their coherence."""
    length = int(min(len(x) // 4, 2 * rate)) // 2 * 2
    f, p_x = spectrum(x, rate, length)
    p_y = spectrum(y, rate, length)[1]
    cross = spectrum(x, rate, length, against=y)[1]
    return f, p_x, p_y, np.abs(cross) ** 2 / np.maximum(p_x * p_y, 1e-300)
