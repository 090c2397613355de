"""How fast the program is against floors measured in the same run; `python -m benchmarks` runs all of them."""

import os

# Before numpy is loaded: threads that wait for each other would count as processor time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
