#!/usr/bin/env bash
# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
# Shows that the installed ruledgraph works: native kernels, and a short recording rendered and
# smoothed. It runs in a new folder, so that it cannot see the sources; the commands are PATH's.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"

ruledgraph --version
python -c 'from ruledgraph.frontend.kernel import is_native
if not is_native(): raise SystemExit("error: the native kernels are missing")'
ruledgraph simulate noncoplanar_cluttered free small.bag --duration 4 --rate 30 --resolution 320x240
ruledgraph smooth small.bag --calibration small.calib.yaml --ground-truth small.gt.tum --output small
ruledgraph report small
