"""Findings and verdicts as something a person or a CI server reads.

One file per output (`machine`, `junit`, `summary`, `html`); `svg` draws the marks, `charts` and
`forest` the figures, `words` and `reason` write numbers and sentences. Nothing here
computes a statistic that a gate rests on.
"""

from gaugeblock.reports.html import report_html
from gaugeblock.reports.junit import junit_xml
from gaugeblock.reports.machine import verdict_json
from gaugeblock.reports.summary import summary_markdown
from gaugeblock.reports.write import rendered, write_reports

__all__ = ["junit_xml", "rendered", "report_html", "summary_markdown", "verdict_json", "write_reports"]
