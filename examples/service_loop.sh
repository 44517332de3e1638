#!/bin/sh
# A control loop in a shell: every request is one line of JSON, and so is every answer.
# It needs `ergoqp` on the PATH; without it, name the command, such as
#   ERGOQP="python -m ergoqp" sh service_loop.sh
set -eu

folder=$(mktemp -d)
mkfifo "$folder/requests" "$folder/answers"
${ERGOQP:-ergoqp} serve screwing --stdio <"$folder/requests" >"$folder/answers" &
service=$!
trap 'kill "$service" 2>/dev/null || true; rm -rf "$folder"' EXIT
exec 3>"$folder/requests" 4<"$folder/answers"

# Send a request, and read its answer.
ask() {
    printf '%s\n' "$1" >&3
    if ! IFS= read -r answer <&4; then
        echo "the service has ended" >&2
        exit 1
    fi
    case $answer in
    *'"error"'*)
        echo "$answer" >&2
        exit 1
        ;;
    esac
}

# Print a list of numbers of the answer.
list() {
    printf '%s\n' "$answer" | sed -n "s/.*\"$1\": \[\([^]]*\)\].*/\1/p"
}

# Print a text of the answer.
word() {
    printf '%s\n' "$answer" | sed -n "s/.*\"$1\": \"\([^\"]*\)\".*/\1/p"
}

# Joints that are not named are not seen. Zero is upright with hanging arms.
posture='"right_shoulder_flexion_deg": 25, "right_elbow_flexion_deg": 80, "trunk_side_bend_deg": 0,
    "trunk_twist_deg": 0, "right_shoulder_abduction_deg": 0, "right_shoulder_rotation_deg": 0,
    "right_forearm_pronation_deg": 0, "right_wrist_flexion_deg": 0, "right_wrist_deviation_deg": 0'
posture=$(printf '%s' "$posture" | tr -d '\n')

# The service assumes nothing about the robot, so the first step reports that it stands.
report='"standing": true, '
trunk=35
while [ "$trunk" -ge 20 ]; do
    ask "{\"step\": {$report\"posture\": {\"trunk_flexion_deg\": $trunk, $posture}}}"
    report=
    # A robot would execute this twist for one period, and then go on with the next one. If there
    # is no next one in time, it would execute the "stop" of this answer.
    echo "trunk $trunk deg: $(word status), twist $(list twist)"
    trunk=$((trunk - 5))
done

# The robot had to execute three periods of the stop, because this loop was late.
ask "{\"step\": {\"followed\": 3, \"posture\": {\"trunk_flexion_deg\": 20, $posture}}}"
echo "after three periods of the stop: $(word status)"

# No camera frame: the object comes to rest.
ask '{"step": {"posture": null}}'
echo "without a frame: $(word status), $(word reason)"

exec 3>&-
wait "$service"
