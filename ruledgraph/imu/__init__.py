# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The IMU's samples: buffer, faults, and the synchronisation with the camera's frames."""
