# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The IMU: its samples, their faults, and states carried forward by them."""
