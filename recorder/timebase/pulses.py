"""UTC against raw time from the receiver's pulse (PPS), one at each full second."""

from recorder.timebase.steering import BEND_NS2_PER_S3, SECOND_NS, Line

PULSE_SIGMA_NS = 10_000.0
"""How far the kernel's stamp of one pulse is off: the interrupt comes sooner or later."""
LATE_SIGMA_NS = 15_000.0
"""How late all of them may be: that is not seen, and not taken off."""
RATE_SIGMA = 30_000.0
"""Of the oscillator before anything is known, ns/s."""
OUTLIER_SIGMAS = 5.0
BELIEVED = 5
"""So many pulses in a row that do not fit are right, and what was known is not."""


class PulseClock:
    """Kalman filter of offset and rate over pulses whose second is known. Not thread-safe."""

    def __init__(self, late_sigma_ns: float = LATE_SIGMA_NS) -> None:
        self._late_variance = late_sigma_ns**2
        self._raw_ns: int | None = None
        self._outliers = 0
        self._restart(0, 0)

    def _restart(self, raw_ns: int, utc_ns: int) -> None:
        self._utc_ns, self._beside_ns, self._rate = utc_ns, 0.0, 0.0
        self._variance, self._covariance, self._rate_variance = PULSE_SIGMA_NS**2, 0.0, RATE_SIGMA**2
        self._outliers = 0

    def observe(self, raw_ns: int, utc_ns: int) -> bool:
        """Take a pulse at a full second of UTC; whether it was believed."""
        if self._raw_ns is None:
            self._restart(raw_ns, utc_ns)
            self._raw_ns = raw_ns
            return True
        age_ns = raw_ns - self._raw_ns
        if age_ns <= 0:
            return False
        age_s = age_ns / 1e9
        bend = BEND_NS2_PER_S3
        variance = self._variance + age_s * (2 * self._covariance + age_s * self._rate_variance)
        variance += bend * age_s**3 / 3
        covariance = self._covariance + age_s * self._rate_variance + bend * age_s**2 / 2
        rate_variance = self._rate_variance + bend * age_s
        # the large numbers cancel as integers; what is left is exact as floating point
        surprise = float(utc_ns - self._utc_ns - age_ns) - self._beside_ns - self._rate * age_s
        total = variance + PULSE_SIGMA_NS**2
        if surprise**2 > OUTLIER_SIGMAS**2 * total:
            self._outliers += 1
            if self._outliers < BELIEVED:
                return False
            self._restart(raw_ns, utc_ns)
            self._raw_ns = raw_ns
            return True
        self._outliers = 0
        predicted = self._beside_ns + self._rate * age_s
        self._beside_ns = predicted + variance / total * surprise
        self._rate += covariance / total * surprise
        self._variance = variance * PULSE_SIGMA_NS**2 / total
        self._covariance = covariance * PULSE_SIGMA_NS**2 / total
        self._rate_variance = rate_variance - covariance**2 / total
        self._raw_ns, self._utc_ns = raw_ns, self._utc_ns + age_ns
        whole_ns = round(self._beside_ns)
        self._utc_ns, self._beside_ns = self._utc_ns + whole_ns, self._beside_ns - whole_ns
        return True

    def line(self) -> Line | None:
        """From the last pulse on; None before the first."""
        if self._raw_ns is None:
            return None
        variance = self._variance + self._late_variance
        rate_pico = round(self._rate * 1000)
        return Line(
            self._raw_ns, self._utc_ns, rate_pico, variance, self._covariance, self._rate_variance, "pps"
        )


def nearest_second(line: Line, raw_ns: int) -> tuple[int, int]:
    """The full second nearest to an instant, and how far from it the line says that it is, both ns."""
    utc_ns = line.at(raw_ns)
    second_ns = (utc_ns + SECOND_NS // 2) // SECOND_NS * SECOND_NS
    return second_ns, abs(utc_ns - second_ns)
