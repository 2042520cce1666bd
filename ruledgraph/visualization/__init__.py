# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Plots, image overlays, the Rerun viewer, the HTML report."""
