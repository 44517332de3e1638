"""Reports: a self-contained page, plain tables in the terminal, and scores as files.

Tables and files need only the core package. Pages need the extra ``report``.
"""
