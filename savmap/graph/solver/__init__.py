"""The solve of one row: rounds of Levenberg-Marquardt, elimination order, residuals, tests of references, solution."""
