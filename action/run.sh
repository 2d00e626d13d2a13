#!/usr/bin/env bash
# Audit, publish the summary, set the outputs, and exit as the audit did. Every input comes as a variable INPUT_...
# and is only ever an argument: nothing here evaluates it.
set -uo pipefail

# Below GitHub's limit of 1 MiB for the summaries of a step, with room for a note.
readonly SUMMARY_BYTES=$((1024 * 1024 - 4096))
# A line that strangers' text cannot contain by accident or by guessing.
mark="gaugeblock-$(od -An -N16 -tx1 /dev/urandom | tr -d ' \n')"
readonly mark

output() { # NAME VALUE, whatever characters the value has
    printf '%s<<%s\n%s\n%s\n' "$1" "$mark" "$2" "$mark" >>"$GITHUB_OUTPUT"
}

refuse() {
    echo "gaugeblock action: $1" >&2
    output verdict ERROR
    output exit-code 2
    exit 2
}

whole_number() { # INPUT VALUE
    [[ $2 =~ ^[0-9]*$ ]] || refuse "$1 must be a whole number"
}

publish() { # FILE, whole or cut at a line end
    local room
    room=$((SUMMARY_BYTES - $(wc -c <"$GITHUB_STEP_SUMMARY")))
    if (($(wc -c <"$1") <= room)); then
        cat "$1" >>"$GITHUB_STEP_SUMMARY"
    elif ((room > 0)); then
        # Bytes, then without the last line, which may be cut in the middle of it or of a character.
        head -c "$room" "$1" | LC_ALL=C sed '$d' >>"$GITHUB_STEP_SUMMARY"
        printf '\n\nCut here: a step summary holds 1 MiB. The whole is in `summary.md`.\n' >>"$GITHUB_STEP_SUMMARY"
    fi
}

touch "$GITHUB_STEP_SUMMARY"
case ${INPUT_FAIL_ON_INCONCLUSIVE:=true} in
    true | false) ;;
    *) refuse "fail-on-inconclusive must be true or false" ;;
esac
case ${INPUT_RELEASE:=false} in
    true | false) ;;
    *) refuse "release must be true or false" ;;
esac
whole_number seed "${INPUT_SEED:=}"
whole_number trials "${INPUT_TRIALS:=}"
cd -- "${INPUT_WORKING_DIRECTORY:-.}" || refuse "there is no such working-directory"

out=${INPUT_OUT:-gaugeblock-audit}
[[ $out == /* ]] || out=$PWD/$out

# --name=value and, at the end, --: no value is taken for an option.
arguments=(audit --quiet "--out=$out")
[[ -z ${INPUT_TRIALS_FILE:-} ]] || arguments+=("--trials=$INPUT_TRIALS_FILE")
[[ -z ${INPUT_POLICY:-} ]] || arguments+=("--policy=$INPUT_POLICY")
[[ -z $INPUT_SEED ]] || arguments+=("--seed=$INPUT_SEED")
[[ -z $INPUT_TRIALS ]] || arguments+=("--set=trials.number=$INPUT_TRIALS")
[[ -z ${INPUT_LEDGER:-} ]] || arguments+=("--ledger=$INPUT_LEDGER")
[[ $INPUT_RELEASE == false ]] || arguments+=(--release)
while IFS= read -r line; do
    [[ -z $line ]] && continue
    [[ $line =~ ^[A-Za-z_][A-Za-z0-9_.]*$ ]] || refuse "allow-module must be names of modules, one a line"
    arguments+=("--allow-module=$line")
done <<<"${INPUT_ALLOW_MODULE:-}"
while IFS= read -r line; do
    [[ -z ${line// /} ]] || arguments+=("--set=$line")
done <<<"${INPUT_SET:-}"
[[ -z ${INPUT_CONFIG:-} ]] || arguments+=(-- "$INPUT_CONFIG")

# A line of output that looks like a command to the runner (::add-mask:: and its like) must not be one.
started=$(mktemp)
echo "::stop-commands::$mark"
# -P: what lies in the working directory is imported for none of gaugeblock's own modules. A module that was allowed
# is looked for there, after everything that is installed.
python -P -m gaugeblock "${arguments[@]}"
code=$?
echo
echo "::$mark::"

case $code in
    0) verdict=PASS ;;
    1) verdict=FAIL ;;
    3) verdict=INCONCLUSIVE ;;
    *) verdict=ERROR ;;
esac
# An exit code alone is nobody's verdict: this run has to have written one, and the same.
if [[ $verdict != ERROR ]]; then
    read_verdict='import json, sys; print(json.load(open(sys.argv[1], encoding="utf-8"))["verdict"])'
    written=$(python -I -c "$read_verdict" "$out/verdict.json" 2>/dev/null)
    if [[ $written != "$verdict" || ! $out/verdict.json -nt $started || ! -s $out/report.html || ! -s $out/summary.md ]]; then
        echo "gaugeblock action: exit code $code, but no reports of this run that say $verdict" >&2
        verdict=ERROR
        code=2
    fi
fi
rm -f "$started"
output verdict "$verdict"
output exit-code "$code"
output out "$out"
if [[ $verdict == ERROR ]]; then
    # An earlier audit's report in the same folder is not this one's.
    output report ""
    echo "gaugeblock could not audit (exit code $code); the log of this step says why." >>"$GITHUB_STEP_SUMMARY"
else
    output report "$out/report.html"
    publish "$out/summary.md"
fi
if [[ $verdict == INCONCLUSIVE && $INPUT_FAIL_ON_INCONCLUSIVE == false ]]; then
    echo "::warning title=gaugeblock::INCONCLUSIVE: these trials do not settle whether the estimator is calibrated"
    exit 0
fi
exit "$code"
