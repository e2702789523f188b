"""Tests that nobody would write by hand: damaged files, any arguments, killed commands, thousands of calls.

`python -m grasptransfer.workshop.soak files|arguments|faults|load --out FOLDER` runs one of them for as long
as asked and prints a table of what was tried, what failed and what was lost; files and faults go on where
they were stopped. Short runs are part of the test suite.

| module | does |
| --- | --- |
| `samples` | a valid file of every format that the package reads, and how it is read |
| `mutations` | a damaged copy of a file, decided by a seed |
| `watch` | reads damaged files in a process of its own, limited in time and memory |
| `run` | the damaged files: their record and table |
| `argument_values`, `arguments` | what callers may give, drawn by Hypothesis; calls that get it |
| `fault_jobs`, `faults` | commands and what must come out of them; killed at random moments, and resumed |
| `load` | many transfers in one process, in threads and in processes |
| `summary` | all of it in one document, of which the README's table is made |
"""
