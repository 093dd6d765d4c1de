"""What one foot's raw readings mean, learnt from what the leg's torques say of the same load.

Nobody has published the unit of an A1's foot sensors, each has a bias of its own, and both drift.
So nothing is assumed: readings of the last seconds of walking are explained by

    raw = gain * newtons + bias + drift * time

in which the newtons are those of :mod:`rmll_onboard.control.leg_force`. Torques err by some ten
newtons under load and hardly ever take a foot in the air for a loaded one, or the other way round
for longer than two policy steps; a sensor that does is doubted. One object a foot, in plain
numbers: NumPy takes longer for so few.
"""

from math import sqrt

KEEP = 0.99
"""Of the past, each policy step: a time constant of 2 s, almost two strides of the slowest gait"""
LEARNING = 75
"""Policy steps of walking until the readings are believed: the slowest stride takes 66"""
EXCITED = 0.25
"""Of the usual load: the load's standard deviation below which a foot has not stepped"""
FOLLOWS = 0.4
"""Squared correlation of reading and load. Of a working sensor it is 0.7 or more, by the torques'
own errors; of noise it is below 0.1"""
LIFTED, LOADED = 0.1, 0.5
"""Of the usual load: where torques leave no doubt"""
WRONG_IN_AIR, WRONG_UNDER_LOAD = 0.15, 0.4
"""Share of steps in which a reading may contradict the torques; of working sensors 0.00 and 0.11"""
_IN_AIR_RATE, _UNDER_LOAD_RATE = 0.03, 0.05
"""Of those averages: a reading that stops is doubted after 6 steps in the air or 10 under load"""
QUIET, NOISY = 0.08, 0.1
"""Of the usual load, a standard deviation in the air: as much noise as a sensor that is trusted may
have at first, and later. A foot counts as pressed at twice that, and a pronk waits for four feet
to be in the air at once"""
STILL, AGAINST = 5, 3
"""Policy steps with one reading, and contradictions meanwhile, that tell a dead sensor"""
GLITCH = 10.0
"""Of the usual load: a reading that far off is none, and the torques are believed in its place"""
RAIL = 32767
"""Of 16 bits"""
_LOOKS = 4
"""Policy steps from one fit to the next; drift is followed in between"""
_FIRST_LOOK = 25
"""Policy steps until a line through the readings says anything"""
_NOTHING = "whatever the load"
_AT_REST = 0.1
"""Of the readings of a standing robot: a time constant of ten policy steps"""


class FootCalibration:
    """Fed once a policy step."""

    def __init__(self, usual: float, pressed: float, turn: int = 0) -> None:
        """``usual`` [N] is the foot's load in standing, above ``pressed`` [N] it is in contact.

        Feet of another ``turn`` are fitted in another policy step.
        """
        self.gain = self.bias = 0.0
        """raw units a newton; raw units in the air, now"""
        self.trusted = False
        """The readings are believed"""
        self.doubt: str | None = None
        """Why it is not, once that is known"""
        self._usual, self._pressed, self._turn = usual, pressed, turn
        self._lifted_below, self._loaded_above = LIFTED * usual, LOADED * usual
        self._moved = 0.0
        self._rest: float | None = None
        self._forget()

    def stand(self, raw: int, force: float) -> None:
        """The robot stands, on legs that bear its weight: the bias may drift, the gain does not.

        ``force`` [N] is by torque.
        """
        if self._age >= LEARNING:
            self._move(self._drift)
            off = raw - self.gain * max(force, 0.0) - self.bias
            self._rest = off if self._rest is None else self._rest + _AT_REST * (off - self._rest)

    def begin(self) -> None:
        """A walk begins."""
        if self._age < LEARNING:
            self._forget()
        elif self._rest is not None:
            self._move(self._rest)
        self._rest = None

    def _move(self, bias: float) -> None:
        """The bias has moved, and all past readings with it, as far as the fit is concerned."""
        self.bias += bias
        self._moved += bias

    def walk(self, raw: int, force: float) -> float:
        """A policy step of a walk; ``force`` [N] is by torque.

        Returns the load [N] that is to be believed.
        """
        force = max(force, 0.0)  # the ground does not pull: what is below is the swing's own
        if raw == self._last:
            self._still += 1
        else:
            self._still = self._against = 0
        if self.trusted:
            self.bias += self._drift
            wild = abs(raw - self.bias) > GLITCH * self._usual * self.gain
            self._wild = self._wild + 1 if wild else 0
        else:
            wild = False
        if not wild:
            self._learn(raw, force)
        if self._age >= LEARNING and (self._looked or self._against or wild):
            self._judge(raw, force)
        self._last = raw
        return self.newtons(raw) if self.trusted and not wild else force

    def newtons(self, raw: int) -> float:
        """The load [N] behind a reading, once there is a gain."""
        return (raw - self.bias) / self.gain

    def _forget(self) -> None:
        self._age = 0
        self._low, self._high = RAIL + 1, -RAIL - 2
        # over the past, weighted by how long ago: the sums of 1, time, its square, load (x),
        # reading (y) and products; time is counted from now on, in policy steps
        self._sums = (0.0,) * 10
        self._drift = 0.0
        self._in_air = self._under_load = self._noise = self._noise_weight = 0.0
        self._lifted = self._untouched = self._excited = self._looked = False
        self._still = self._last = self._against = self._wild = 0
        self._follows = 0.0

    def _learn(self, raw: int, force: float) -> None:
        if raw < self._low:
            self._low = raw
        if raw > self._high:
            self._high = raw
        self._keep(raw - self._moved, force)
        self._age += 1
        self._looked = self._age >= _FIRST_LOOK and self._age % _LOOKS == self._turn
        if self._looked:
            self._follows = self._fit()
        if self._follows > FOLLOWS:
            self._compare(raw, force)

    def _keep(self, y: float, x: float) -> None:
        n, t, tt, sx, sy, xx, xy, yy, tx, ty = self._sums
        # a step later, all that was is one step further ago
        self._sums = (
            KEEP * n + 1.0,
            KEEP * (t - n),
            KEEP * (tt - 2 * t + n),
            KEEP * sx + x,
            KEEP * sy + y,
            KEEP * xx + x * x,
            KEEP * xy + x * y,
            KEEP * yy + y * y,
            KEEP * (tx - sx),
            KEEP * (ty - sy),
        )

    def _fit(self) -> float:
        """Least squares for gain, bias and drift; returns the squared correlation, drift removed.

        0 for a foot that has not stepped, or whose readings fall under load.
        """
        n, t, tt, sx, sy, xx, xy, yy, tx, ty = self._sums
        scale = n * tt - t * t
        # of load and reading: the value now and the slope of a line through the past
        x, x_slope = (tt * sx - t * tx) / scale, (n * tx - t * sx) / scale
        y, y_slope = (tt * sy - t * ty) / scale, (n * ty - t * sy) / scale
        # and what is left over it
        xx -= x * sx + x_slope * tx
        xy -= x * sy + x_slope * ty
        yy -= y * sy + y_slope * ty
        self._excited = xx > n * (EXCITED * self._usual) ** 2
        if not self._excited or xy <= 0.0 or yy <= 0.0:
            return 0.0
        self.gain = xy / xx
        self.bias = y - self.gain * x + self._moved
        self._drift = y_slope - self.gain * x_slope
        return xy * xy / (xx * yy)

    def _compare(self, raw: int, force: float) -> None:
        """Count where reading and torques contradict each other."""
        pressed = self.newtons(raw) > self._pressed
        before, self._lifted = self._lifted, force < self._lifted_below
        untouched, self._untouched = self._untouched, not pressed
        if before and self._lifted:
            self._against += pressed
            self._in_air += _IN_AIR_RATE * (pressed - self._in_air)
            # torques may miss the first moment of a touch, which is no noise
            if untouched and not pressed:
                # a difference has the noise of two readings
                jump = (raw - self._last) / self.gain
                self._noise += _IN_AIR_RATE * (0.5 * jump * jump - self._noise)
                self._noise_weight += _IN_AIR_RATE * (1.0 - self._noise_weight)
        elif force > self._loaded_above:
            self._against += not pressed
            self._under_load += _UNDER_LOAD_RATE * (1 - pressed - self._under_load)

    def _judge(self, raw: int, force: float) -> None:
        if not self._excited:
            return
        doubt = self._why(raw, force)
        if self.trusted and doubt:
            # whatever has happened to the sensor, what was learnt before is of another one
            self._forget()
        self.trusted = doubt is None
        # the first word on a sensor stays, unless it turns out that it tells nothing at all
        if not (doubt and self.doubt) or (_NOTHING in doubt and _NOTHING not in self.doubt):
            self.doubt = doubt

    def _why(self, raw: int, force: float) -> str | None:
        """What is wrong with the sensor, in words."""
        deaf = self._follows <= FOLLOWS
        contradicts = max(self._against, self._wild) >= AGAINST
        if self._low == self._high or (self._still >= STILL and (deaf or contradicts)):
            return f"{'saturated, ' if abs(raw) >= RAIL else ''}reads {raw} {_NOTHING}"
        if self._wild > STILL:
            return f"reads {raw}, which no load explains"
        if deaf:
            return f"reads {self._low} to {self._high} {_NOTHING}"
        if self._in_air > WRONG_IN_AIR or self._under_load > WRONG_UNDER_LOAD:
            felt = self.newtons(raw)
            return f"reads {raw}, which is {felt:.0f} N, where the leg bears {force:.0f} N"
        noise = sqrt(self._noise / (self._noise_weight or 1.0)) / self._usual
        if noise > (NOISY if self.trusted else QUIET):
            load = self._usual * self.gain
            return f"too noisy: scatters by {noise * load:.1f} where standing adds {load:.1f}"
        return None
