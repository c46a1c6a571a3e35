"""The site report: one HTML page that needs no other file and no network."""

from savmap.report.page.summary import Report
from savmap.report.page.write import page_text, write_page

__all__ = ["Report", "page_text", "write_page"]
