# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Images and IMU samples on one clock and in order: stamps, time offset, frames that wait."""
