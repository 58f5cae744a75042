"""The offline tool: identify the model from measured TCP positions, see where it fails."""

import os

# Matrices are small here: threads of the linear algebra library cost more than they bring (set before numpy loads).
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
