# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What all packages share: measurements, estimates, trajectories, settings, errors."""
