#!/usr/bin/env bash
# safetensors 0.8.0, numpy 2.4.6, Linux, Python 3.11.
#
# save_file() leaves a file of mode 0600 whatever the umask is, where open(..., "w") in the same folder
# leaves 0644 (umask 022). A service under another user, or a web server, then cannot read a policy that
# was written beside world-readable files. save(), which returns bytes, leaves the mode to the writer.
#
# Seen: save_file 0o600, open 0o644, save and write_bytes 0o644
# Exits with 1 if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check safetensors==0.8.0 numpy==2.4.6
umask 022
"$folder/venv/bin/python" - "$folder" <<'PYTHON'
import sys
from pathlib import Path

import numpy as np
from safetensors.numpy import save, save_file

folder, tensors = Path(sys.argv[1]), {"weight": np.zeros(3, np.float32)}
save_file(tensors, folder / "a.safetensors")
(folder / "b.txt").write_text("plain")
(folder / "c.safetensors").write_bytes(save(tensors))
modes = [oct((folder / name).stat().st_mode & 0o777) for name in ("a.safetensors", "b.txt", "c.safetensors")]
print("save_file {}, open {}, save and write_bytes {}".format(*modes))
sys.exit(modes != ["0o600", "0o644", "0o644"])
PYTHON
