"""A check as sentences, as a page, as a card in a notebook, as pictures on axes."""

from gaugeblock.reports.check.axes import PICTURES, draw_check
from gaugeblock.reports.check.html import check_card, check_html
from gaugeblock.reports.check.sentences import check_lines

__all__ = ["PICTURES", "check_card", "check_html", "check_lines", "draw_check"]
