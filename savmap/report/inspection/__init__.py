"""Inspections: what the plugins find in a finished map, as records, a page for people, and files for programs."""

from savmap.report.inspection.files import write_inspection as write_inspection
from savmap.report.inspection.header import page_header as page_header
from savmap.report.inspection.inspect import inspect_map as inspect_map
from savmap.report.inspection.page import InspectionPage as InspectionPage
