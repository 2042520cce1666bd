# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Results folders as one HTML page: figures, tables, pictures, settings, warnings."""

from ruledgraph.visualization.report.batch import write_batch_report
from ruledgraph.visualization.report.page import write_report
from ruledgraph.visualization.report.run import ReportError

__all__ = ["ReportError", "write_batch_report", "write_report"]
