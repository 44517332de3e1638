"""Reports: one self-contained page, plain tables in the terminal, scores as files.

The tables and the files need nothing beyond the core; the pages need the extra ``report``.
"""
