"""Reports: one self-contained page, plain tables in the terminal, scores as files.

The tables and the files need nothing beyond the core; the pages need the extra ``report``.
"""

from ergoqp.report.run_page import write_run_page as write_run_page
from ergoqp.report.score_page import write_score_page as write_score_page
from ergoqp.report.scores import summary_of as summary_of
from ergoqp.report.scores import write_scores as write_scores
from ergoqp.report.tables import run_table as run_table
from ergoqp.report.tables import score_table as score_table
