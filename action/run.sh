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

annotate() { # error|warning TEXT: one line beside the job, whatever characters the text has
    local text
    text=$(tr -s '[:cntrl:]' ' ' <<<"${2:0:900}")
    text=${text%% }
    printf '::%s title=gaugeblock::%s\n' "$1" "${text//%/%25}"
}

explain() { # TEXT: why there is no verdict, in the summary; as a block of code, in which nothing is a link or a picture
    local text
    text=$(tr -s '[:cntrl:]' ' ' <<<"${1:0:900}")
    printf 'gaugeblock could not audit:\n\n    %s\n' "${text%% }" >>"$GITHUB_STEP_SUMMARY"
}

refuse() {
    echo "gaugeblock action: $1" >&2
    annotate error "$1"
    explain "$1"
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
errors=$(mktemp)
echo "::stop-commands::$mark"
# -P: what lies in the working directory is imported for none of gaugeblock's own modules. A module that was allowed
# is looked for there, after everything that is installed.
{
    python -P -m gaugeblock "${arguments[@]}" 2>&1 1>&3 3>&- | tee "$errors" >&2 3>&-
    code=${PIPESTATUS[0]}
} 3>&1
echo
echo "::$mark::"

case $code in
    0) verdict=PASS ;;
    1) verdict=FAIL ;;
    3) verdict=INCONCLUSIVE ;;
    *) verdict=ERROR ;;
esac
reason=
# An exit code alone is nobody's verdict: this run has to have written one, and the same.
if [[ $verdict != ERROR ]]; then
    read_verdict='import json, sys; print(json.load(open(sys.argv[1], encoding="utf-8"))["verdict"])'
    written=$(python -I -c "$read_verdict" "$out/verdict.json" 2>/dev/null)
    if [[ $written != "$verdict" || ! $out/verdict.json -nt $started || ! -s $out/report.html || ! -s $out/summary.md ]]; then
        reason="exit code $code, but no reports of this run that say $verdict"
        echo "gaugeblock action: $reason" >&2
        verdict=ERROR
        code=2
    fi
fi
if [[ $verdict == ERROR && -z $reason ]]; then
    reason=$(grep '^gaugeblock: ' "$errors" | tail -n 1)
    reason=${reason#gaugeblock: }
    : "${reason:=exit code $code, and not a word; the log of this step may say more}"
elif [[ $verdict == FAIL || $verdict == INCONCLUSIVE ]]; then
    read_reason='
import json, sys
gates = json.load(open(sys.argv[1], encoding="utf-8"))["gates"]
those = [gate for gate in gates if gate["verdict"] == sys.argv[2] and (gate["required"] or sys.argv[2] == "FAIL")]
more = [f"and {len(those) - 2} more gates"] * (len(those) > 2)
print(" | ".join([gate["id"] + ": " + gate["message"] for gate in those[:2]] + more))'
    reason=$(python -I -c "$read_reason" "$out/verdict.json" "$verdict" 2>/dev/null)
fi
rm -f "$started" "$errors"
output verdict "$verdict"
output exit-code "$code"
output out "$out"
if [[ $verdict == ERROR ]]; then
    # An earlier audit's report in the same folder is not this one's.
    output report ""
    explain "$reason"
    annotate error "$reason"
else
    output report "$out/report.html"
    publish "$out/summary.md"
fi
if [[ $verdict == INCONCLUSIVE && $INPUT_FAIL_ON_INCONCLUSIVE == false ]]; then
    annotate warning "INCONCLUSIVE: these trials do not settle whether the estimator is calibrated. $reason"
    exit 0
fi
[[ $verdict == FAIL || $verdict == INCONCLUSIVE ]] && annotate error "$verdict: $reason"
exit "$code"
