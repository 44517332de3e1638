% A control loop in MATLAB or Octave: lines of JSON by TCP on this machine.
%
% Start the service first, and give this script what its log says:
%   ergoqp serve screwing --tcp 5555
%   matlab -batch "port = 5555; token_file = '/run/user/1000/ergoqp/tcp.token'; service_loop"
% Octave 7 has tcpclient in its package instrument-control.
if exist('OCTAVE_VERSION', 'builtin')
    pkg load instrument-control
end
if ~exist('port', 'var')
    port = 5555;
end
if ~exist('token_file', 'var')
    token_file = fullfile(getenv('XDG_RUNTIME_DIR'), 'ergoqp', 'tcp.token');
end
dt = 0.01; % control period of the problem [s]

door = tcpclient('127.0.0.1', port);
% The first line is the token, which only this user can read, and what is spoken then.
write(door, uint8([strtrim(fileread(token_file)) ' json' char(10)]));

% Joints that are not named are not seen. Zero is upright with hanging arms.
posture = struct('trunk_flexion_deg', 35, 'trunk_side_bend_deg', 0, 'trunk_twist_deg', 0, ...
    'right_shoulder_flexion_deg', 25, 'right_shoulder_abduction_deg', 0, ...
    'right_shoulder_rotation_deg', 0, 'right_elbow_flexion_deg', 80, ...
    'right_forearm_pronation_deg', 0, 'right_wrist_flexion_deg', 0, ...
    'right_wrist_deviation_deg', 0);

% The service assumes nothing about the robot, so the first step reports that it stands.
step = struct('posture', posture, 'standing', true);
for period = 1:5
    write(door, uint8([jsonencode(struct('step', step)) char(10)]));
    line = '';
    while isempty(line) || line(end) ~= char(10)
        line = [line char(read(door, max(1, door.NumBytesAvailable)))];
    end
    answer = jsondecode(line);
    if isfield(answer, 'error')
        error('%s', answer.error);
    end
    since = tic;
    fprintf('%s %s: twist %s\n', answer.status, answer.reason, mat2str(answer.twist', 4));
    posture.trunk_flexion_deg = posture.trunk_flexion_deg - 5;

    % A robot would execute answer.twist for one period, and then the rows of answer.stop, one per
    % period, until the next answer. The next step says how many of them.
    step = struct('followed', max(0, ceil(toc(since) / dt) - 1));
    if period < 4
        step.posture = posture; % without one no frame has arrived, and the object comes to rest
    end
end
