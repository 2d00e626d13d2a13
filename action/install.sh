#!/usr/bin/env bash
# Install gaugeblock from the action's own checkout, so that the action's version is the package's.
set -euo pipefail

if [[ ! ${INPUT_EXTRAS:-} =~ ^[a-z0-9_,\ -]*$ ]]; then
    echo "gaugeblock action: extras must be names separated by commas, as in sbi,xray" >&2
    exit 2
fi
requirement=$GITHUB_ACTION_PATH
[[ -z ${INPUT_EXTRAS// /} ]] || requirement+="[${INPUT_EXTRAS// /}]"
# -P: what lies in the working directory is not imported in place of what is installed.
python -P -m pip install --quiet --disable-pip-version-check "$requirement"
