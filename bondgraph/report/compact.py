"""SVG of a figure in few letters, with the same look: what a page holds many pictures by.

Coordinates are rounded to a hundredth of a point, far below what a screen shows, and written as steps from one point to
the next (https://www.w3.org/TR/SVG11/paths.html). Styles are written once, as classes; names of glyphs and clips are
short; dots of one size are one path of round caps.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import lru_cache
from urllib.parse import quote
from xml.etree import ElementTree

#: Decimals of a coordinate in points: a hundredth of 1/72 inch is 0.013 pixels of a screen.
_DECIMALS = 2
#: Letters of a path beyond which it is worth a name. A convention.
_LONG = 200
#: Marks of a line beyond which they are one path, since each is written with its style and name. A
#: convention.
_FEW_MARKS = 20
#: Digits of the short names: letters only, since a class must not begin with a number.
_LETTERS = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
#: Characters that may stand as they are in a data URI between double quotes; spaces would end it in a list of sources.
_PLAIN = "<>='/:;,.!*()+-_{}@$?[]|~"
_COMMANDS = re.compile(r"[A-Za-z]|-?[\d.]+(?:e-?\d+)?")
_REFERENCE = re.compile(r"url\(#([^)]+)\)")
_START = re.compile(r"M[-.\d]+,?[-.\d]+(?=[a-z])")
_COORDINATES = re.compile(r"-?\d*\.?\d+")
_SHIFT = re.compile(r"translate\((-?[\d.]+)[ ,]+(-?[\d.]+)\)")
_SVG, _HREF = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}href"


def compact_svg(text: str) -> str:
    """The SVG text of a figure as matplotlib writes it, shorter and with the same look.

    Examples
    --------
    >>> compact_svg('<svg xmlns="http://www.w3.org/2000/svg"><g id="a"><path d="M 1.004 2 L 1 4.5 L 3 4 z"/></g></svg>')
    '<svg xmlns="http://www.w3.org/2000/svg"><path d="M1,2v2.5l2-.5z" /></svg>'
    """
    root = ElementTree.fromstring(text)
    _rounded_dots(root)
    used = _used(root)
    names = {name: _name(place) for place, name in enumerate(used)}
    _shortened(root, names)
    shared = _shared(root, len(names))
    _classes(root, len(names) + shared)
    root.set("xmlns", _SVG[1:-1])
    return ElementTree.tostring(root, encoding="unicode")


def svg_uri(svg: str) -> str:
    """SVG text as a data URI that may stand between double quotes, in a list of sources too.

    Examples
    --------
    >>> svg_uri('<svg xmlns="http://www.w3.org/2000/svg"><path fill="#fff" /></svg>')
    "data:image/svg+xml,<svg%20xmlns='http://www.w3.org/2000/svg'><path%20fill='%23fff'/></svg>"
    """
    return f"data:image/svg+xml,{quote(svg.replace(' />', '/>').replace(chr(34), chr(39)), safe=_PLAIN)}"


def _used(root: ElementTree.Element) -> list[str]:
    """Names that something refers to, the most frequent first."""
    found: Counter[str] = Counter()
    for one in root.iter():
        for value in one.attrib.values():
            found.update(_REFERENCE.findall(value))
        if one.get(_HREF, "").startswith("#"):
            found[one.attrib[_HREF][1:]] += 1
    return [name for name, _ in found.most_common()]


def _name(place: int) -> str:
    rest, last = divmod(place, len(_LETTERS))
    return (_name(rest - 1) if rest else "") + _LETTERS[last]


def _shortened(parent: ElementTree.Element, names: dict[str, str]) -> None:
    """Every element below in few letters, groups without attributes and texts between elements left out."""
    parent.tag = parent.tag.removeprefix(_SVG)
    parent.tail = None
    _attributes(parent, names)
    if len(parent):
        parent.text = None
    children: list[ElementTree.Element] = []
    for child in parent:
        if child.tag == f"{_SVG}metadata":
            continue
        _shortened(child, names)
        dissolved = child.tag == "g" and not child.attrib
        children.extend(child if dissolved else [child])
    parent[:] = [child for child in children if child.tag not in ("g", "defs") or len(child)]


def _attributes(one: ElementTree.Element, names: dict[str, str]) -> None:
    given = dict(one.attrib)
    one.attrib.clear()
    for key, value in given.items():
        if key == "id":
            if value in names:
                one.set("id", names[value])
        elif key == _HREF:
            one.set("href", f"#{names[value[1:]]}" if value.startswith("#") else re.sub(r"\s", "", value))
        elif key == "d":
            one.set("d", _path(value))
        elif key == "style":
            one.set("style", re.sub(r"\s*([:;])\s*", r"\1", value))
        elif key in ("x", "y"):
            one.set(key, _rounded(value))
        elif key == "transform":
            _transform(one, value)
        elif key != "version":
            one.set(key, _REFERENCE.sub(lambda found: f"url(#{names[found[1]]})", value))


def _transform(one: ElementTree.Element, value: str) -> None:
    """A transform with shifts rounded; a shift alone of a use is its place."""
    shift = _SHIFT.fullmatch(value)
    if shift and one.tag == "use":
        for key, number in zip("xy", shift.groups(), strict=True):
            if float(number):
                one.set(key, _rounded(number))
        return
    short = _SHIFT.sub(lambda found: f"translate({_rounded(found[1])},{_rounded(found[2])})", value)
    one.set("transform", short.replace(") ", ")").replace(" ", ","))


def _rounded(number: str) -> str:
    return _number(round(float(number) * _SCALE))


def _shared(root: ElementTree.Element, taken: int) -> int:
    """How many long paths are drawn at several places, such as dots that stand in two panels, and are written once."""
    found: dict[str, list[ElementTree.Element]] = {}
    for one in root.iter("path"):
        start = _START.match(one.get("d", ""))
        if start and len(one.attrib["d"]) > _LONG and "id" not in one.attrib and "transform" not in one.attrib:
            found.setdefault(one.attrib["d"][start.end() :], []).append(one)
    often = [(steps, paths) for steps, paths in found.items() if len(paths) > 1]
    for place, (steps, paths) in enumerate(often):
        name = _name(taken + place)
        root.insert(0, _inside("defs", ElementTree.Element("path", {"id": name, "d": f"M0,0{steps}"})))
        for one in paths:
            x, y = _COORDINATES.findall(one.attrib.pop("d")[1 : -len(steps)])
            use = ElementTree.Element("use", {"href": f"#{name}", "x": x, "y": y})
            one.tag = "g"  # which keeps style and clip, since those of a use may move with it
            one.append(use)
    return len(often)


def _inside(tag: str, child: ElementTree.Element) -> ElementTree.Element:
    parent = ElementTree.Element(tag)
    parent.append(child)
    return parent


def _classes(root: ElementTree.Element, taken: int) -> None:
    """Styles that occur more than once, as classes."""
    styles = Counter(one.attrib["style"] for one in root.iter() if "style" in one.attrib)
    often = [style for style, count in styles.most_common() if count > 1]
    classes = {style: _name(taken + place) for place, style in enumerate(often)}
    for one in root.iter():
        style = one.attrib.get("style")
        if style in classes:
            del one.attrib["style"]
            one.set("class", classes[style])
    sheet = next((one for one in root.iter("style")), None)
    if sheet is None:
        sheet = ElementTree.Element("style")
        root.insert(0, sheet)
    own = "".join(f".{name}{{{style}}}" for style, name in classes.items())
    sheet.text = re.sub(r"\s*([:;{])\s*", r"\1", (sheet.text or "") + own)
    if not sheet.text:
        root.remove(sheet)


def _path(text: str) -> str:
    """Data of a path as steps between points that are rounded from its start on: the same wherever it starts."""
    words = _COMMANDS.findall(text)
    if not set(filter(str.isalpha, words)) <= _LENGTHS.keys():
        return text  # of another writer than the one whose form is known
    out: list[str] = []
    start, here, begun, last = (0.0, 0.0), (0, 0), (0, 0), ""
    place = 0
    while place < len(words):
        command, count = words[place], _LENGTHS[words[place]]
        given = [float(word) * _SCALE for word in words[place + 1 : place + 1 + count]]
        numbers = [round(value - start[k % 2]) for k, value in enumerate(given)]
        place += 1 + count
        if command == "z":
            letter, here = "z", begun
        elif not out:
            letter, start = "M", (given[0], given[1])
        elif command == "M":
            letter, begun = "m", (numbers[0], numbers[1])
            numbers = [value - origin for value, origin in zip(numbers, here, strict=True)]
            here = begun
        else:
            letter, end = command.lower(), (numbers[-2], numbers[-1])
            numbers = [value - here[k % 2] for k, value in enumerate(numbers)]
            letter, numbers = _straight(letter, numbers)
            here = end
        out.append(_written(letter, letter != last or letter in "mz", numbers))
        last = letter
    return "".join(out)


#: Numbers behind each command that matplotlib writes.
_LENGTHS = {"M": 2, "L": 2, "Q": 4, "C": 6, "z": 0}
_SCALE = 10**_DECIMALS


def _straight(letter: str, numbers: list[int]) -> tuple[str, list[int]]:
    """A step along an axis in its short form."""
    if letter == "l" and numbers[0] and not numbers[1]:
        return "h", numbers[:1]
    return ("v", numbers[1:]) if letter == "l" and not numbers[0] else (letter, numbers)


def _written(letter: str, named: bool, numbers: Sequence[int]) -> str:
    """A command with its numbers; where a sign or a second point separates two, nothing else does."""
    out = letter if named else ""
    decimal = named  # whether the number before has a point, or there is none
    for place, value in enumerate(numbers):
        text = _number(value)
        joined = (place == 0 and named) or text[0] == "-" or (text[0] == "." and decimal)
        out += text if joined else f",{text}"
        decimal = "." in text
    return out


@lru_cache(maxsize=1 << 14)
def _number(hundredths: int) -> str:
    """A number of hundredths without zeros that say nothing.

    Examples
    --------
    >>> [_number(value) for value in (-50, 1200, 7, 0)]
    ['-.5', '12', '.07', '0']
    """
    whole, part = divmod(abs(hundredths), _SCALE)
    decimals = f".{part:0{_DECIMALS}d}".rstrip("0") if part else ""
    return f"{'-' if hundredths < 0 else ''}{whole or (0 if not part else '')}{decimals}"


def _rounded_dots(root: ElementTree.Element) -> None:
    """Dots that a line has at its points, as one path of lines without length and with round ends."""
    marks = {one.attrib["id"]: one for one in root.iter(f"{_SVG}path") if "id" in one.attrib}
    for group, uses in _marked(root):
        mark = marks.get(uses[0].attrib.get(_HREF, "#")[1:])
        diameter, fill = _disc(mark), re.search(r"fill: (#\w+)", uses[0].get("style", ""))
        if not diameter or fill is None:
            continue
        for use in uses:
            group.remove(use)
        data = "".join(f"M {use.attrib['x']} {use.attrib['y']} L {use.attrib['x']} {use.attrib['y']} " for use in uses)
        style = f"fill:none;stroke:{fill[1]};stroke-width:{diameter:g};stroke-linecap:round"
        group.append(ElementTree.Element(f"{_SVG}path", {"d": data, "style": style}))


def _marked(root: ElementTree.Element) -> Iterator[tuple[ElementTree.Element, list[ElementTree.Element]]]:
    """Groups with many uses of one mark in one style."""
    for group in root.iter(f"{_SVG}g"):
        uses = [one for one in group if one.tag == f"{_SVG}use"]
        if len(uses) > _FEW_MARKS and len({(one.get(_HREF), one.get("style")) for one in uses}) == 1:
            yield group, uses


def _disc(mark: ElementTree.Element | None) -> float:
    """Diameter of a mark that is a disc without an edge, else zero.

    Eight curves about the origin whose ends lie on one circle are what matplotlib writes for a disc.
    """
    if mark is None or "stroke: none" not in mark.get("style", "stroke: none"):
        return 0.0
    words = _COMMANDS.findall(mark.attrib.get("d", ""))
    if [word for word in words if word.isalpha()] != ["M", *"CCCCCCCC", "z"]:
        return 0.0
    numbers = [float(word) for word in words if not word.isalpha()]
    radii = [(x * x + y * y) ** 0.5 for x, y in zip(numbers[::6], numbers[1::6], strict=False)]
    return 2.0 * radii[0] if max(radii) - min(radii) < 1e-3 * max(radii) else 0.0
