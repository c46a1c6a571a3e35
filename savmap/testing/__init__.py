"""The contract that any plugin must satisfy, as a function for its own tests.

from savmap.testing import check_plugin
def test_contract():
    check_plugin(MyPlugin)
"""

from savmap.testing.contract import check_plugin

__all__ = ["check_plugin"]
