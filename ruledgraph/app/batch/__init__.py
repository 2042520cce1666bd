# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Many runs at once, on this machine's cores or on many machines, by dask.distributed."""
