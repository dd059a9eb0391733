"""Topics of VDA 5050: ``interfaceName/majorVersion/manufacturer/serialNumber/topic``."""

from __future__ import annotations

from dataclasses import dataclass

from firstfix.errors import InvalidOption

MAJORS = ("v2", "v3")
MAX_TOPIC_CHARS = 512
ANY = "+"


@dataclass(frozen=True)
class VehicleName:
    """Name of a vehicle: the first levels of all its topics.

    Attributes:
        interface: one level or several.
        major: of the protocol, such as ``v2``.
        serial: the vehicle's serialNumber.
    """

    interface: str
    major: str
    manufacturer: str
    serial: str

    def __str__(self) -> str:
        return self.topic("")[:-1]

    def topic(self, name: str) -> str:
        """One of the vehicle's topics."""
        return f"{self.interface}/{self.major}/{self.manufacturer}/{self.serial}/{name}"

    @classmethod
    def of_topic(cls, topic: str) -> tuple[VehicleName, str] | None:
        """Whose topic it is and its last level; None if it is not one of a vehicle."""
        levels = topic.rsplit("/", 4)
        if len(levels) < 5 or not all(levels) or len(topic) > MAX_TOPIC_CHARS or not topic.isprintable():
            return None
        interface, major, manufacturer, serial, name = levels
        return cls(interface, major, manufacturer, serial), name


@dataclass(frozen=True)
class VehicleFilter:
    """Filter of the vehicles of a fleet, as the first levels of their topics.

    Attributes:
        levels: each a name, or ``+`` for any.
    """

    levels: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> VehicleFilter:
        """Read ``uagv/v2/acme/+``.

        Raises:
            InvalidOption: not of this form.
        """
        levels = tuple(text.split("/"))
        if len(levels) < 4 or not all(levels) or len(text) > MAX_TOPIC_CHARS:
            raise InvalidOption(
                "the topics of vehicles are interfaceName/majorVersion/manufacturer/serialNumber, "
                f"not {text[:200]!r}"
            )
        if any("#" in level or (ANY in level and level != ANY) for level in levels):
            raise InvalidOption(f"{text!r}: a level of the topics of vehicles is a name, or + for any")
        if levels[-3] not in (*MAJORS, ANY):
            raise InvalidOption(f"{text!r}: the major version is one of {', '.join(MAJORS)}, or +")
        return cls(levels)

    def matches(self, vehicle: VehicleName) -> bool:
        """Whether a vehicle is one of the fleet."""
        levels = str(vehicle).split("/")
        return len(levels) == len(self.levels) and all(
            wanted in (ANY, level) for wanted, level in zip(self.levels, levels, strict=True)
        )

    def of(self, name: str) -> str:
        """The filter of one topic of all these vehicles."""
        return "/".join((*self.levels, name))
