"""The words with which engineers name columns, by language and by what is logged, and how they join word and unit."""

from __future__ import annotations

from collections.abc import Callable, Mapping

# What is logged -> what it is called; a space parts the words.
ENGLISH: Mapping[str, tuple[str, ...]] = {
    "heading": ("heading", "hdg", "yaw", "compass", "ins heading", "gyro heading", "psi"),
    "yaw_rate": ("yaw rate", "rate of turn", "gyro z", "r"),
    "time": ("time", "t", "elapsed"),
    "stamp": ("timestamp", "utc", "datetime"),
    "epoch": ("timestamp", "epoch", "unix time"),
    "command": ("{role}", "{role} thruster", "thruster {role}", "{role} cmd", "thr {role}", "motor {role}"),
    "port": ("port",),
    "stbd": ("stbd", "starboard"),
    "vertical": ("vertical", "vert"),
    "bow": ("bow thruster", "bow tunnel", "bow"),
    "stern": ("stern thruster", "stern tunnel", "stern"),
    "fore": ("fwd", "front"),
    "aft": ("aft", "rear"),
    "desired_heading": ("desired heading", "heading setpoint", "heading ref", "target heading", "hdg cmd"),
    "heading_error": ("heading error", "hdg err", "yaw error"),
    "course": ("cog", "gps course", "course over ground"),
    "lights": ("lights", "light level", "led brightness"),
    "camera": ("camera tilt", "cam tilt"),
    "current": ("{role} current", "current {role}"),
    "feedback": ("{role} fb", "{role} speed", "{role} actual"),
    "temperature": ("{role} temp", "motor temp {role}"),
    "battery": ("battery", "batt", "battery remaining"),
    "supply": ("battery voltage", "supply", "bus voltage"),
    "stick_yaw": ("joystick yaw", "joy x", "stick yaw"),
    "stick_surge": ("joystick surge", "joy y", "stick fwd"),
    "depth": ("depth",),
    "roll": ("roll",),
    "pitch": ("pitch",),
    "speed": ("sog", "speed over ground", "surge velocity"),
    "water": ("water temp",),
    "counter": ("sample", "frame", "seq"),
    "surge": ("surge velocity", "dvl vx", "surge", "stw"),
    "heel": ("roll", "heel"),
}
GERMAN: Mapping[str, tuple[str, ...]] = {
    "heading": ("kurs", "steuerkurs", "gierwinkel", "kompass"),
    "yaw_rate": ("drehrate", "gierrate", "wendegeschwindigkeit"),
    "time": ("zeit",),
    "stamp": ("zeitstempel", "datum uhrzeit"),
    "epoch": ("zeitstempel", "unix"),
    "command": ("{role}", "motor {role}", "stellwert {role}", "schub {role}", "thruster {role}"),
    "port": ("backbord", "bb"),
    "stbd": ("steuerbord", "stb"),
    "vertical": ("vertikal", "vertikalschub"),
    "bow": ("bugstrahler", "bug"),
    "stern": ("heckstrahler", "heck"),
    "fore": ("vorn", "vorne"),
    "aft": ("achtern", "hinten"),
    "desired_heading": ("sollkurs", "kurs soll"),
    "heading_error": ("kursfehler", "kursabweichung"),
    "course": ("kurs über grund", "küg"),
    "lights": ("scheinwerfer", "licht"),
    "camera": ("kamera neigung",),
    "current": ("strom {role}",),
    "feedback": ("ist {role}", "{role} istwert"),
    "temperature": ("temperatur {role}",),
    "battery": ("akku", "batterie ladung"),
    "supply": ("spannung", "batteriespannung"),
    "stick_yaw": ("joystick gier", "steuerknüppel x"),
    "stick_surge": ("joystick voraus", "steuerknüppel y"),
    "depth": ("tiefe",),
    "roll": ("rollwinkel", "krängung"),
    "pitch": ("nickwinkel", "trimm"),
    "speed": ("fahrt über grund", "geschwindigkeit"),
    "water": ("wassertemperatur",),
    "counter": ("nr", "zähler"),
    "surge": ("surge geschwindigkeit", "dvl vx"),
    "heel": ("rollwinkel", "krängung"),
}
FRENCH: Mapping[str, tuple[str, ...]] = {
    "heading": ("cap", "lacet", "cap vrai"),
    "yaw_rate": ("vitesse lacet", "taux de giration", "vitesse de lacet"),
    "time": ("temps",),
    "stamp": ("horodatage", "date heure"),
    "epoch": ("horodatage", "unix"),
    "command": ("{role}", "propulseur {role}", "moteur {role}", "commande {role}"),
    "port": ("babord", "bâbord"),
    "stbd": ("tribord",),
    "vertical": ("vertical",),
    "bow": ("propulseur etrave", "etrave"),
    "stern": ("propulseur poupe", "poupe"),
    "fore": ("avant",),
    "aft": ("arriere", "arrière"),
    "desired_heading": ("consigne cap", "cap consigne", "cap désiré"),
    "heading_error": ("erreur cap", "écart de cap"),
    "course": ("route fond",),
    "lights": ("phares", "eclairage"),
    "camera": ("inclinaison caméra", "camera tilt"),
    "current": ("courant {role}",),
    "feedback": ("mesure {role}", "{role} mesuré"),
    "temperature": ("température {role}", "temp moteur {role}"),
    "battery": ("batterie",),
    "supply": ("tension", "tension batterie"),
    "stick_yaw": ("manche lacet", "joystick x"),
    "stick_surge": ("manche avance", "joystick y"),
    "depth": ("profondeur", "immersion"),
    "roll": ("roulis", "gite"),
    "pitch": ("tangage", "assiette"),
    "speed": ("vitesse fond",),
    "water": ("température eau",),
    "counter": ("numero", "indice"),
    "surge": ("vitesse avance", "dvl vx"),
    "heel": ("roulis", "gite"),
}
NORWEGIAN: Mapping[str, tuple[str, ...]] = {
    "heading": ("kurs", "heading", "gir"),
    "yaw_rate": ("girrate", "svingerate"),
    "time": ("tid",),
    "stamp": ("tidsstempel", "dato tid"),
    "epoch": ("tidsstempel", "unix"),
    "command": ("{role}", "thruster {role}", "pådrag {role}", "motor {role}"),
    "port": ("babord",),
    "stbd": ("styrbord",),
    "vertical": ("vertikal",),
    "bow": ("baugthruster", "baug"),
    "stern": ("hekkthruster", "hekk"),
    "fore": ("forre", "forut"),
    "aft": ("aktre", "akter"),
    "desired_heading": ("ønsket kurs", "kurs settpunkt"),
    "heading_error": ("kursfeil", "kursavvik"),
    "course": ("kurs over grunn",),
    "lights": ("lys", "lyskastere"),
    "camera": ("kamera tilt",),
    "current": ("strøm {role}",),
    "feedback": ("turtall {role}", "{role} målt"),
    "temperature": ("temperatur {role}",),
    "battery": ("batteri",),
    "supply": ("spenning", "batterispenning"),
    "stick_yaw": ("joystick gir", "spak x"),
    "stick_surge": ("joystick frem", "spak y"),
    "depth": ("dybde",),
    "roll": ("rull",),
    "pitch": ("stamp",),
    "speed": ("fart over grunn",),
    "water": ("vanntemperatur",),
    "counter": ("teller", "nr"),
    "surge": ("surge hastighet", "dvl vx"),
    "heel": ("rull",),
}
SPANISH: Mapping[str, tuple[str, ...]] = {
    "heading": ("rumbo", "guiñada"),
    "yaw_rate": ("velocidad guiñada", "velocidad de giro"),
    "time": ("tiempo",),
    "stamp": ("fecha hora", "marca de tiempo"),
    "epoch": ("marca de tiempo", "unix"),
    "command": ("{role}", "motor {role}", "propulsor {role}", "mando {role}"),
    "port": ("babor",),
    "stbd": ("estribor",),
    "vertical": ("vertical",),
    "bow": ("helice de proa", "proa"),
    "stern": ("helice de popa", "popa"),
    "fore": ("proa",),
    "aft": ("popa",),
    "desired_heading": ("rumbo deseado", "consigna rumbo"),
    "heading_error": ("error rumbo", "error de rumbo"),
    "course": ("rumbo sobre fondo", "rumbo gps"),
    "lights": ("luces",),
    "camera": ("inclinacion camara",),
    "current": ("corriente {role}",),
    "feedback": ("{role} medido", "medida {role}"),
    "temperature": ("temperatura {role}",),
    "battery": ("bateria",),
    "supply": ("tension bateria", "voltaje"),
    "stick_yaw": ("palanca giro", "joystick x"),
    "stick_surge": ("palanca avance", "joystick y"),
    "depth": ("profundidad",),
    "roll": ("balanceo", "escora"),
    "pitch": ("cabeceo",),
    "speed": ("velocidad fondo",),
    "water": ("temperatura agua",),
    "counter": ("muestra", "contador"),
    "surge": ("velocidad avance", "dvl vx"),
    "heel": ("balanceo", "escora"),
}
LANGUAGES = {"en": ENGLISH, "de": GERMAN, "fr": FRENCH, "no": NORWEGIAN, "es": SPANISH}

# Unit -> in brackets, and at the end of a word.
UNITS: Mapping[str, Mapping[str, tuple[str, str]]] = {
    "en": {"deg": ("deg", "deg"), "rpm": ("rpm", "rpm"), "%": ("%", "pct")},
    "de": {"deg": ("Grad", "grad"), "rpm": ("1/min", "upm"), "%": ("%", "prozent")},
    "fr": {"deg": ("°", "deg"), "rpm": ("tr/min", "trmin"), "%": ("%", "pct")},
    "no": {"deg": ("grader", "grader"), "rpm": ("o/min", "rpm"), "%": ("%", "prosent")},
    "es": {"deg": ("grados", "grados"), "rpm": ("rpm", "rpm"), "%": ("%", "pct")},
}
_ELSEWHERE: Mapping[str, tuple[str, str]] = {
    "deg/s": ("deg/s", "dps"),
    "rad/s": ("rad/s", "rad_s"),
    "us": ("µs", "us"),
    "N m": ("N m", "Nm"),
    "m/s": ("m/s", "mps"),
    "C": ("°C", "C"),
    "1": ("-1..1", ""),
    "permille": ("", ""),
    "": ("", ""),
}


def unit_words(unit: str, language: str) -> tuple[str, str]:
    """How ``unit`` is written in brackets and at the end of a word."""
    found = UNITS[language].get(unit) or _ELSEWHERE.get(unit)
    return found or (unit, unit)


def _camel(words: str) -> str:
    return "".join(word[:1].upper() + word[1:] for word in words.split())


def _bracketed(words: str, unit: str, brackets: str) -> str:
    name = " ".join(word if word.isupper() else word.capitalize() for word in words.split())
    return f"{name} {brackets[0]}{unit}{brackets[1]}" if unit else name


def _snake(words: str, suffix: str) -> str:
    return "_".join([*words.split(), *([suffix] if suffix else [])])


# Style -> column from (group, words, unit in brackets, unit at the end of a word).
STYLES: Mapping[str, Callable[[str, str, str, str], str]] = {
    "snake": lambda _, words, _unit, suffix: _snake(words, suffix),
    "bracket": lambda _, words, unit, _suffix: _bracketed(words, unit, "[]"),
    "paren": lambda _, words, unit, _suffix: _bracketed(words, unit, "()"),
    "camel": lambda _, words, _unit, suffix: _camel(f"{words} {suffix}"),
    "upper": lambda _, words, _unit, suffix: _snake(words, suffix).upper(),
    "dots": lambda group, words, _unit, suffix: f"{group}.{_snake(words, suffix)}",
    "spaces": lambda _, words, _unit, suffix: f"{words} {suffix}".strip(),
    "bare": lambda _, words, _unit, _suffix: _snake(words, ""),
    "topic": lambda group, words, _unit, _suffix: f"/{group}/{_snake(words, '')}.data",
}
