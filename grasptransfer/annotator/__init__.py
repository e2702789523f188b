"""Annotating grasps of a category's canonical model in the browser; needs the extra `annotate`.

`annotator.browser.annotate` serves it; a `Session` does the same without a browser.
"""

from grasptransfer.annotator.session import Measurement, Session

__all__ = ["Measurement", "Session"]
