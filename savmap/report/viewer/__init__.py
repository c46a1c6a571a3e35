"""The viewer: `view.html`, a map that is looked at, searched and measured in a browser, without a network or a
server."""

from savmap.report.viewer.data import Before as Before
from savmap.report.viewer.page import Origin as Origin
from savmap.report.viewer.page import View as View
from savmap.report.viewer.page import write_view as write_view
