"""Benchmarks: what a renderer costs that no picture shows, for every variant of a study.

``python -m benchmarks.NAME STUDY`` in a checkout of the repository, with NAME one of `rays`,
`kernels`, `memory` and `startup`, and STUDY as for ``mitsuba-restir evaluate``, or a file beside
this one.
"""
