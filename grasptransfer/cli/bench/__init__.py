"""`grasptransfer bench …`: each benchmark prints its summary and writes the JSON of `document.py`."""
