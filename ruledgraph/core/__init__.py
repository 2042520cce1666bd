# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What every room shares: measurements, estimates, trajectories, settings, errors."""
