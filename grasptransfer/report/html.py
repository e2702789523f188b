"""HTML pages from Jinja2 templates; every value is escaped."""

from pathlib import Path
from typing import NamedTuple

from jinja2 import Environment, FileSystemLoader, StrictUndefined

TEMPLATES = Path(__file__).with_name("templates")


class Figure(NamedTuple):
    """A picture with its caption.

    Args:
        uri: data URI of the picture.
        alt: what it shows, for whoever cannot see it.
        caption: text below it.
        legend: pairs of a colour and what it marks, written before the caption.
    """

    uri: str
    alt: str
    caption: str = ""
    legend: tuple[tuple[tuple[int, int, int], str], ...] = ()


class Fact(NamedTuple):
    """A named value; a `kind` ("good", "bad" or "neutral") shows it as a coloured word."""

    name: str
    value: str
    kind: str = ""


def render(template: str, *, folder: Path = TEMPLATES, **values) -> str:
    """The page of a template with these values.

    Args:
        template: file name.
        folder: where it lies; it may extend and import the templates of this room.
        values: by the names that the template uses; a missing one raises.
    """
    environment = Environment(
        loader=FileSystemLoader([folder, TEMPLATES]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(**values)
