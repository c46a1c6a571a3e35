"""The site report: one HTML page that holds all it needs."""

from savmap.report.page.write import page_text, write_page

__all__ = ["page_text", "write_page"]
