"""The paper: Adaptive Hierarchical Distributed Control. ``PAPER.md`` maps symbols and equations to code.

Pure: data and time come in as arguments; only ``math``, ``numpy`` and ``contract`` are imported.
"""
