# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Trajectory segments: the stages that serve them, one segment, and their sequence."""
