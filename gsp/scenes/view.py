"""Views of a scene: which quantities its author wants to see against which, where, and under what title."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import KW_ONLY, dataclass, field
from types import MappingProxyType

from gsp.errors import DeclarationError, UnknownNameError
from gsp.systems.arguments import check_among, check_plain_word, check_text, shown
from gsp.systems.region import Interval, check_interval

TIME = "t"
LONGEST_TITLE = 200


@dataclass(frozen=True)
class View:
    """`x` across and `y` up, with a `z` in space: names of states, observables, reconstruction variables, or t.

    `ranges` {name: (low, high)} bounds axes that are not to follow the runs; `title` is text.
    """

    x: str
    y: str
    z: str | None = None
    _: KW_ONLY
    title: str = ""
    ranges: Mapping[str, Interval] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """The quantities of the axes, in their order."""
        return (self.x, self.y) if self.z is None else (self.x, self.y, self.z)

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "ranges": dict(self.ranges)}

    def __hash__(self) -> int:
        return hash((self.names, self.title, tuple(self.ranges.items())))


def view_named(views: Mapping[str, View], name: object) -> View:
    """The view of this name; raises `UnknownNameError` for what is none."""
    if isinstance(name, str) and name in views:
        return views[name]
    fact = f"view is the name of one of the scene's views, and not {shown(name)}."
    if not views:
        raise UnknownNameError(
            fact, "The scene has none: give it one, as [views.NAME] in its model file.", value=name
        )
    raise UnknownNameError.none_of(views, name, fact, "They are")


def checked_views(views: object, known: Collection[str]) -> dict[str, View]:
    """Views by name, whose quantities are among `known` or t; raises `DeclarationError` that names what is none."""
    if not isinstance(views, Mapping):
        raise DeclarationError("views maps names to views.", got=shown(views), value=views)
    return {
        check_plain_word(name, what="the name of a view"): _checked(
            name, view, [*dict.fromkeys([*known, TIME])]
        )
        for name, view in views.items()
    }


def _checked(name: str, view: object, known: list[str]) -> View:
    if not isinstance(view, View):
        raise DeclarationError(
            f"the view {name} is no View.", 'Write View("t", "x").', got=shown(view), value=view
        )
    for quantity in view.names:
        fact = f"the view {name} shows {shown(quantity)}, which is no state, observable or reconstruction variable."
        check_among(quantity, known, fact, "There are")
    if len(set(view.names)) < len(view.names):
        raise DeclarationError(
            f"the view {name} shows a quantity twice.", "Take another.", got=", ".join(view.names)
        )
    check_text(view.title, what=f"the title of the view {name}")
    if len(view.title) > LONGEST_TITLE or not view.title.isprintable():
        raise DeclarationError(
            f"the title of the view {name} is text of at most {LONGEST_TITLE} characters on one line.",
            got=shown(view.title),
            value=view.title,
            limit=LONGEST_TITLE,
        )
    if not isinstance(view.ranges, Mapping):
        raise DeclarationError(
            f"the ranges of the view {name} map names to (low, high).",
            got=shown(view.ranges),
            value=view.ranges,
        )
    ranges = {}
    for quantity, interval in view.ranges.items():
        fact = f"the view {name} has a range of {shown(quantity)}, which it does not show."
        check_among(quantity, view.names, fact, "It shows")
        ranges[quantity] = check_interval(
            interval,
            what=f"range of {quantity} in the view {name}",
            remedy="Give (low, high), low below high.",
        )
    return View(view.x, view.y, view.z, title=view.title, ranges=MappingProxyType(ranges))
