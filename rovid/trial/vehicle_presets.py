"""Published data of known vehicle types, for a first rovid.toml. The folder vehicles/ holds one file a type."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rovid.core.errors import ConfigError, suggestion
from rovid.core.input_files import expected_number, read_toml
from rovid.trial.axis import word_set

_FOLDER = Path(__file__).parent / "vehicles"
_NUMBERS = ("mass", "length", "width", "supply")
_KEYS = ("name", *_NUMBERS, "curve", "sources", "arms", "senses_alone")
# Side that a thruster is named by -> words for it in the names of columns.
SIDE_WORDS: Mapping[str, frozenset[str]] = {
    "port": word_set("port left links bb backbord babord bâbord gauche babor sinistra sinistro"),
    "starboard": word_set(
        "starboard stbd right rechts stb steuerbord tribord droite estribor styrbord dritta destra destro"
    ),
    "bow": word_set(
        """bow fore fwd forward front bug vorn avant proue proa baug etrave étrave bugstrahl bugstrahler bugstrahlruder
        baugthruster forre"""
    ),
    "stern": word_set(
        """stern aft rear heck achtern arriere arrière poupe popa poppa heckstrahl heckstrahler heckstrahlruder
        hekkthruster hekk akter aktre"""
    ),
}


@dataclass(frozen=True, kw_only=True)
class VehiclePreset:
    """Published data of a vehicle type."""

    id: str  #: Name on the command line.
    name: str
    arms: Mapping[str, float]  #: Thruster -> yaw arm in m. A thruster is named by its motor number or its side.
    senses_alone: bool = False  #: Whether only the signs of the arms are known.
    #: ``mass``, ``length``, ``width``: kg, m, m; None where not published.
    mass: float | None = None
    length: float | None = None
    width: float | None = None
    curve: Path | None = None  #: Thrust curve, command in us; None where not published.
    supply: float | None = None  #: Supply voltage of the curve in V.
    sources: tuple[str, ...] = ()  #: References for the numbers.

    def label(self, words: set[str]) -> str:
        """Thruster commanded by a column with these words in its name; empty if none.

        Where the type numbers its motors, another number is one of its motors without an arm.
        """
        for label in self.arms:
            if label in words or words & SIDE_WORDS.get(label, frozenset()):
                return label
        numbered = all(map(str.isdigit, self.arms))
        return next((word for word in sorted(words) if numbered and word.isdigit()), "")


def preset_names() -> list[str]:
    """Names of the built-in types."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def load_preset(name: str) -> VehiclePreset:
    """The built-in type ``name``, or the type described by the file ``name`` if that ends in .toml."""
    own = Path(name)
    if own.suffix == ".toml":
        return _read(own, own.stem)
    known = {re.sub(r"[\W_]", "", each): each for each in preset_names()}
    found = known.get(re.sub(r"[\W_]", "", name.lower()))
    if found is None:
        text = f"there is no vehicle {name!r}. {suggestion(name, preset_names())}"
        mend = f"Known vehicles: {', '.join(preset_names())}. You can also give a file of your own, as my_rov.toml."
        raise ConfigError(text, mend=mend)
    return _read(_FOLDER / f"{found}.toml", found)


def _read(path: Path, name: str) -> VehiclePreset:
    document = read_toml(path)
    for key in document:
        if key not in _KEYS:
            raise ConfigError(f"has the unknown key {key!r}. {suggestion(key, _KEYS)}", where=path)
    arms = document.get("arms")
    if not isinstance(arms, dict) or not arms or any(map(expected_number, arms.values())):
        text = "has no [arms]: a yaw arm in m for each thruster was expected."
        raise ConfigError(text, where=path, mend="Add port = 0.3, say.")
    for key in _NUMBERS:
        if key in document and expected_number(document[key], positive=True):
            raise ConfigError(f"{key} is {document[key]!r}; a positive number was expected.", where=path)
    curve = document.get("curve")
    if curve is not None and not (isinstance(curve, str) and (path.parent / curve).is_file()):
        raise ConfigError(f"curve is {curve!r}; the name of a file in the same folder was expected.", where=path)
    sources = document.get("sources", [])
    if not isinstance(sources, list) or not all(isinstance(one, str) for one in sources):
        raise ConfigError("sources must be a list of texts.", where=path)
    return VehiclePreset(
        id=name,
        name=str(document.get("name", name)),
        arms={label: float(arm) for label, arm in arms.items()},
        senses_alone=document.get("senses_alone") is True,
        curve=None if curve is None else path.parent / curve,
        sources=tuple(sources),
        **{key: float(document[key]) for key in _NUMBERS if key in document},
    )
