"""How a receiver on a serial line is brought to say what serves: its rate, NMEA, the right sentences.

Only decisions: the driver hands in what it hears and does what is asked. Nothing here waits.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from recorder.drivers import sirf
from recorder.drivers.protocols import recognise
from recorder.errors import DeviceUnsuitable
from recorder.samples import NmeaSentence

RATES = (4800, 9600, 38400, 57600, 115200, 19200)
"""Baud, the likeliest first."""
DWELL_NS = 1_600_000_000
"""At one rate when nothing sound is heard: a receiver speaks once a second. Doubles with every round
of the rates, up to four times as long."""
BYTES_A_RATE = 600
"""Without anything sound among so many the rate is wrong: a sentence has 82 at most."""
FRAMING_ERRORS = 8
"""As many, counted by the kernel, and the rate is wrong."""
BINARY_NS = 1_500_000_000
"""A receiver may mix binary frames with NMEA: so long is waited for some before it is refused."""
GARBAGE_BYTES = 1024
"""As many in a row in which nothing is sound, and the receiver has changed its rate or protocol."""
ANSWER_NS = 2_500_000_000
"""In which a receiver that was told to speak NMEA does."""
LEAVING_NS = 200_000_000
"""After which what was written has left the adapter, too, and the rate may be changed."""
TRIES = 3
SETTLING, WATCHED = 3, 6
"""Bursts let pass after a command, then watched: the BU-353 says GSV every fifth."""
WATCH_NS = 15_000_000_000
"""The longest that a watch takes: a receiver may have been told to say nothing at all."""
_OF_PLAIN_TEXT = ("checksum", "cut", "fields")
_TEXT_LINES, _TEXT_BYTES = 4, 12
"""As many lines of text, each as long, without a sound checksum tell that the rate is right."""
_KEPT_BYTES = 4096
"""Of what was heard: enough for two of the longest binary frames in use."""
_SIRF = "SiRF binary"


@dataclass(frozen=True, slots=True)
class SetBaud:
    """Go on at this rate."""

    baud: int


@dataclass(frozen=True, slots=True)
class Send:
    """Write this to the receiver."""

    data: bytes


@dataclass(frozen=True, slots=True)
class Say:
    """An event for people and the drive's log."""

    level: Literal["info", "warning"]
    message: str


Action = SetBaud | Send | Say


class ReceiverSetup:
    """One receiver from the opening of its port on.

    Hunting: at each rate in turn until NMEA or a binary protocol is heard. Switching: SiRF binary was
    heard, the receiver is told to speak NMEA. Listening: NMEA is heard; the receiver is told what to
    say and, for as long as it speaks, watched whether it obeys.

    Args:
        rates: to try, in this order; one alone is kept.
        configure: whether the receiver may be written to.
        where: the port, for messages.
    """

    def __init__(self, rates: Sequence[int], *, configure: bool, where: str) -> None:
        self._rates, self._configure, self._where = tuple(rates), configure, where
        self.baud = self._rates[0]
        self.speaks = ""
        """NMEA once it is heard, before that nothing."""
        self.obeys: bool | None = None
        """Whether it says what it was told to say; None while that is not known."""
        self._state: Literal["hunting", "switching", "listening"] = "hunting"
        self._since_ns: int | None = None
        self._heard, self._looked_at = bytearray(), 0
        self._found: Counter[str] = Counter()
        self._text_lines = self._passed = self._tries = self._framing = self._bytes = 0
        self._commanded, self._new_baud = 0, self.baud
        self._kinds: Counter[str] = Counter()
        self._settled = False
        self._last_told = ""

    @property
    def hunting(self) -> bool:
        """Whether the kernel's count of framing errors is of interest."""
        return self._state == "hunting"

    def hear(
        self, data: bytes, sentences: Sequence[NmeaSentence], now_ns: int, *, framing_errors: int = 0
    ) -> list[Action]:
        """What to do after these bytes (none: silence) and the pieces that they completed.

        Raises `DeviceUnsuitable` if the receiver speaks what cannot be recorded from.
        """
        if self._since_ns is None:
            self._since_ns = now_ns
        self._heard += data
        self._bytes += len(data)
        if len(self._heard) > _KEPT_BYTES:
            del self._heard[:-_KEPT_BYTES]
            self._looked_at = 0
        self._framing += framing_errors
        kinds = [kind for one in sentences if (kind := _kind(one)) is not None]
        text_lines = sum(one.problem in _OF_PLAIN_TEXT and len(one.data) >= _TEXT_BYTES for one in sentences)
        self._text_lines += text_lines
        if self._state != "listening":
            if kinds or self._text_lines >= _TEXT_LINES:
                return self._listen(now_ns, sound=bool(kinds))
            return self._hunt(now_ns) if self._state == "hunting" else self._switching(now_ns)
        if kinds or text_lines:
            self._forget()
        if len(self._heard) > GARBAGE_BYTES:
            self._begin("hunting", now_ns)
            self._bytes, self.speaks = 0, ""
            return [Say("warning", f"no NMEA any more at {self.baud} baud, looking for it again")]
        self._kinds.update(kinds)
        return self._watch(now_ns)

    def _hunt(self, now_ns: int) -> list[Action]:
        found = self._look()
        since_ns = now_ns - (self._since_ns or 0)
        if found[_SIRF]:
            if not self._configure:
                raise self._unsuitable(_SIRF, "set drivers.gnss.configure = true to have it switched")
            self._begin("switching", now_ns)
            self._tries = 0
            say = Say("info", f"speaks SiRF binary at {self.baud} baud, is told to speak NMEA")
            return [say, *self._switch()]
        name, count = (found.most_common(1) or [("", 0)])[0]
        if count > 1:
            if since_ns > BINARY_NS:
                raise self._unsuitable(name, "switch it to NMEA with its maker's program")
            return []
        dwell_ns = DWELL_NS << min(self._passed // len(self._rates), 2)
        wrong = self._framing >= FRAMING_ERRORS or len(self._heard) > BYTES_A_RATE
        leave = since_ns > dwell_ns or (wrong and len(self._rates) > 1)
        return self._next_rate(now_ns) if leave else []

    def _next_rate(self, now_ns: int) -> list[Action]:
        self._begin("hunting", now_ns)
        self._passed += 1
        actions: list[Action] = []
        if self._passed == len(self._rates):
            at = f"{self.baud}" if len(self._rates) == 1 else f"any rate from {min(RATES)} to {max(RATES)}"
            what = f"{self._bytes} bytes that make no sense" if self._bytes else "nothing at all"
            actions.append(Say("warning", f"no NMEA at {at} baud, {what}; going on to listen"))
        if len(self._rates) > 1:
            self.baud = self._rates[(self._rates.index(self.baud) + 1) % len(self._rates)]
            actions.append(SetBaud(self.baud))
        return actions

    def _look(self) -> Counter[str]:
        """Binary frames in what was heard; looked for again when enough has been added."""
        if len(self._heard) >= self._looked_at + max(32, self._looked_at // 4):
            self._looked_at = len(self._heard)
            self._found = recognise(bytes(self._heard))
        return self._found

    def _switch(self) -> list[Action]:
        """Message 129 names the rate in 16 bits, so from 115200 the receiver is taken to 57600."""
        self._tries += 1
        baud = self.baud if self.baud < 1 << 16 else 57600
        self._new_baud = baud
        return [Send(sirf.switch_to_nmea(baud, dict.fromkeys(sirf.SERVING, 1)))]

    def _switching(self, now_ns: int) -> list[Action]:
        since_ns = now_ns - (self._since_ns or 0)
        if self._new_baud != self.baud and since_ns > LEAVING_NS:
            self.baud = self._new_baud
            self._rates = tuple(dict.fromkeys((*self._rates, self.baud)))
            self._forget()
            return [SetBaud(self.baud)]
        if since_ns <= ANSWER_NS:
            return []
        if not self._look()[_SIRF]:
            self._begin("hunting", now_ns)
            return []
        if self._tries >= TRIES:
            raise self._unsuitable(_SIRF, "it does not obey the command to speak NMEA: unplug and plug it")
        self._begin("switching", now_ns)
        return self._switch()

    def _listen(self, now_ns: int, *, sound: bool) -> list[Action]:
        switched = ", switched from SiRF binary" if self._state == "switching" else ""
        self._begin("listening", now_ns)
        self._passed, self.speaks = 0, "NMEA"
        say = Say("info", f"speaks NMEA at {self.baud} baud{switched}")
        if not sound:
            what = f"its lines at {self.baud} baud have no sound checksums: recorded, not read"
            say = Say("warning", what)
        self._commanded, self.obeys, self._last_told = 0, None, ""
        return [say, *self._command(now_ns)]

    def _command(self, now_ns: int) -> list[Action]:
        self._kinds.clear()
        self._settled, self._since_ns = False, now_ns
        if not self._configure:
            return []
        self._commanded += 1
        return [Send(sirf.only_serving())]

    def _watch(self, now_ns: int) -> list[Action]:
        """Judge what was said in some bursts; command again if it is not what was commanded."""
        if not self._configure:
            return []
        bursts = max(self._kinds.values(), default=0)
        late = now_ns - (self._since_ns or 0) > WATCH_NS
        if not self._settled and (bursts >= SETTLING or late):
            self._settled, self._since_ns = True, now_ns
            self._kinds.clear()
            return []
        if not self._settled or not (bursts >= WATCHED or late):
            return []
        needless = [kind for kind in sirf.MESSAGES if kind not in sirf.SERVING and self._kinds[kind]]
        missing = [kind for kind in sirf.SERVING if not self._kinds[kind]]
        self._kinds.clear()
        self._since_ns = now_ns
        if not needless and not missing:
            self._commanded, self.obeys = 0, True
            return self._tell("info", f"obeys: {', '.join(sirf.SERVING)} and nothing else")
        if self._commanded < TRIES:
            return self._command(now_ns)
        self.obeys = False
        faults = [f"{', '.join(missing)} missing"] if missing else []
        faults += [f"{', '.join(needless)} still said"] if needless else []
        return self._tell("warning", f"does not obey $PSRF103: {'; '.join(faults)}; recorded as it is")

    def _tell(self, level: Literal["info", "warning"], message: str) -> list[Action]:
        """A change, once."""
        if message == self._last_told:
            return []
        self._last_told = message
        return [Say(level, message)]

    def _begin(self, state: Literal["hunting", "switching", "listening"], now_ns: int) -> None:
        self._state, self._since_ns = state, now_ns
        self._forget()

    def _forget(self) -> None:
        self._heard.clear()
        self._found = Counter()
        self._looked_at = self._text_lines = self._framing = 0

    def _unsuitable(self, protocol: str, todo: str) -> DeviceUnsuitable:
        return DeviceUnsuitable(f"speaks {protocol}, not NMEA", where=self._where, todo=todo)


def _kind(sentence: NmeaSentence) -> str | None:
    """Of a sound sentence of a talker; None for a maker's own, such as our commands in an echo."""
    if sentence.problem or sentence.data[1:2] == b"P":
        return None
    return sentence.data[3:6].decode("ascii", "replace")
