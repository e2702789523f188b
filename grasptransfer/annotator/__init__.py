"""Annotating grasps of a category's canonical model in the browser; needs the extra `annotate`."""

from grasptransfer.annotator.session import Measurement, Session

__all__ = ["Measurement", "Session", "annotate"]


def annotate(*arguments, **options) -> None:
    """Serve the annotator; see `annotator.browser.annotate`."""
    from grasptransfer.annotator.browser import annotate as serve

    serve(*arguments, **options)
