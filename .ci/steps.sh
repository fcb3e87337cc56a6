# Sourced by .ci/run: steps one after the other, one more beside them, and a table of their seconds at the end.
# shellcheck shell=bash

scratch=$(mktemp -d) # removed at the end
table=()             # a line for each step that has ended
step='' begun=0 beside='' beside_pid=0

line() { table+=("$(printf '%7s  %s' "$1" "$2")"); } # SECONDS TEXT

run() { # NAME COMMAND...: a step; ends the script if it fails
    step=$1 begun=$SECONDS
    printf '\n== [%3d s] %s\n' "$SECONDS" "$step"
    "${@:2}"
    line $((SECONDS - begun)) "$step"
    step=''
    if [ -n "$beside" ] && [ -e "$scratch/ended" ] && [ "$(cut -d' ' -f1 "$scratch/ended")" != 0 ]; then join; fi
}

run_beside() { # NAME COMMAND...: a step that goes on beside those that follow, until `join`
    beside=$1
    set -m # in a process group of its own, so that all of it can be ended
    (
        set +e
        begun=$SECONDS
        "${@:2}" >"$scratch/output" 2>&1
        echo "$? $((SECONDS - begun))" >"$scratch/ended"
    ) &
    set +m
    beside_pid=$!
}

join() { # wait for what goes on beside, and show what it printed; ends the script if it failed
    local code seconds
    step="$beside, beside others" begun=$SECONDS
    printf '\n== [%3d s] %s\n' "$SECONDS" "$step"
    wait "$beside_pid"
    beside=''
    cat "$scratch/output"
    read -r code seconds <"$scratch/ended"
    rm "$scratch/ended"
    [ "$code" = 0 ] || exit "$code"
    line "$seconds" "$step"
    step=''
}

close() {
    local code=$?
    if [ -n "$beside" ]; then kill -- "-$beside_pid" 2>/dev/null || true; fi
    rm -rf "$scratch"
    [ -z "$step" ] || line $((SECONDS - begun)) "$step: FAILED"
    line "$SECONDS" "in all"
    printf '\n== seconds\n'
    printf '%s\n' "${table[@]}"
    exit $code
}
trap close EXIT
trap 'exit 130' INT TERM
