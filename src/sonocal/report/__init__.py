"""What to trust, on one page: a self-contained HTML file and its figures. Needs the extra ``sonocal[report]``."""

from sonocal.report.page import report_html
from sonocal.report.pictures import FrameImage
from sonocal.report.verdict import Verdict, give_verdict

__all__ = ["FrameImage", "Verdict", "give_verdict", "report_html"]
