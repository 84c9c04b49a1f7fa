function result = mock_simulink(action, varargin)
% A Simulink that only keeps the books: blocks, parameters, lines. It refuses what the real one would refuse.
% The ports of FMU blocks come from the JSON file in SIMULINK_MOCK, in an order of its own.
persistent state
if isempty(state)
    state = struct('blocks', {{}}, 'lines', {{}}, 'model', '', 'settings', struct(), 'workspace', struct(), ...
        'loaded', {{}}, 'saved', '', 'handles', {{}}, 'compiled', {{}}, 'fmus', jsondecode(fileread(getenv('SIMULINK_MOCK'))));
end
result = [];
switch action
    case 'new_system'
        state.model = varargin{1};
    case 'loaded'
        result = strcmp(state.model, varargin{1});
    case 'load_system'
        state.loaded{end + 1} = varargin{1};
    case 'close_system'
        state = [];
    case 'save_system'
        state.saved = varargin{2};
    case 'add_block'
        state = add_block_(state, varargin{:});
    case 'set_param'
        state = set_param_(state, varargin{:});
    case 'get_param'
        result = get_param_(state, varargin{:});
    case 'add_line'
        state = add_line_(state, varargin{2}, varargin{3});
    case 'mex'
        named = strcmp(varargin, '-output');
        for word = varargin(cellfun(@(text) any(text == '.') && text(1) == '/', varargin))
            if ~exist(word{1}, 'file')
                error('mock: mex finds no %s', word{1});
            end
        end
        state.compiled{end + 1} = varargin{find(named) + 1};
    case 'assign'
        state.workspace.(varargin{1}) = varargin{2};
    case 'dump'
        file = fopen(varargin{1}, 'w');
        fputs(file, jsonencode(rmfield(state, {'fmus', 'handles'})));
        fclose(file);
end
end


function state = add_block_(state, kind, path, varargin)
libraries = {'simulink_extras/FMU Import/FMU', 'simulink/Sources/From Workspace', 'simulink/Sources/Constant', ...
    'simulink/Sinks/To Workspace', 'simulink/Math Operations/Gain', 'simulink/Math Operations/Bias', ...
    'simulink/Discrete/Unit Delay', 'simulink/User-Defined Functions/S-Function'};
if ~any(strcmp(kind, libraries)) || ~any(strcmp(strtok(kind, '/'), state.loaded))
    error('mock: no library block %s', kind);
end
name = name_of(state, path);
if ~isvarname(name) || find_block(state, name)
    error('mock: the block name %s is bad or taken', name);
end
block = struct('name', name, 'kind', kind, 'parameters', {{}}, 'inputs', {{}}, 'outputs', {{}});
own_ports = {'simulink_extras/FMU Import/FMU', 'simulink/User-Defined Functions/S-Function'};
if ~any(strcmp(kind, [own_ports, {'simulink/Sources/From Workspace', 'simulink/Sources/Constant'}]))
    block.inputs = {1};
end
if ~any(strcmp(kind, [own_ports, {'simulink/Sinks/To Workspace'}]))
    block.outputs = {1};
end
state.blocks{end + 1} = block;
if ~isempty(varargin)
    state = set_param_(state, path, varargin{:});
end
end


function state = set_param_(state, path, varargin)
if mod(numel(varargin), 2) || ~all(cellfun(@ischar, varargin(1:2:end)))
    error('mock: set_param wants names and values');
end
for k = 1:2:numel(varargin)
    [name, value] = varargin{k:k + 1};
    if ~ischar(value) && ~any(strcmp(name, {'Position', 'MaskPrompts', 'MaskValues'}))
        error('mock: the value of %s is no text', name);
    end
    if strcmp(path, state.model)
        if strcmp(name, 'SimulationCommand')
            state = ask_for_ports(state);
            continue
        end
        state.settings.(name) = value;
        continue
    end
    b = find_block(state, name_of(state, path));
    state.blocks{b}.parameters(end + 1) = {{name, value}};
    if strcmp(name, 'FMUName')
        fmu = state.fmus.(strrep(value, '.fmu', ''));
        if isempty(which_file(value))
            error('mock: %s is not on the path', value);
        end
        state.blocks{b}.inputs = cellstr_(fmu.inputs);
        state.blocks{b}.outputs = cellstr_(fmu.outputs);
        state.blocks{b}.known = cellstr_(fmu.parameters);
        state.blocks{b}.labelled = fmu.labelled;
    elseif isfield(state.blocks{b}, 'known') && ~isempty(state.blocks{b}.known) && ...
            ~any(strcmp(name, [state.blocks{b}.known(:)', {'FMUSampleTime', 'Position'}]))
        error('mock: the FMU block %s has no parameter %s', state.blocks{b}.name, name);
    end
end
end


function state = ask_for_ports(state)
% S-functions have the ports that their compiled file declares, in the order of the FMU, which the JSON has reversed.
for b = 1:numel(state.blocks)
    block = state.blocks{b};
    if strcmp(block.kind, 'simulink/User-Defined Functions/S-Function')
        given = cellfun(@(pair) strcmp(pair{1}, 'FunctionName'), block.parameters);
        name = block.parameters{given}{2};
        if ~any(strcmp(name, state.compiled))
            error('mock: %s is not compiled', name);
        end
        fmu = state.fmus.(strrep(name, '_sfun', ''));
        state.blocks{b}.inputs = fliplr(cellstr_(fmu.inputs));
        state.blocks{b}.outputs = fliplr(cellstr_(fmu.outputs));
    end
end
end


function file = which_file(name)
file = file_in_loadpath(name);
end


function result = get_param_(state, path, name)
if strcmp(path, state.model)
    result = struct('assignin', @(variable, value) mock_simulink('assign', variable, value));
    return
end
b = find_block(state, name_of(state, path));
block = state.blocks{b};
switch name
    case 'PortHandles'
        result = struct('Inport', b * 1000 + (1:numel(block.inputs)), ...
            'Outport', b * 1000 + 500 + (1:numel(block.outputs)));
    case 'MaskDisplay'
        given = cellfun(@(pair) strcmp(pair{1}, 'MaskDisplay'), block.parameters);
        if any(given)
            result = block.parameters{given}{2};
            return
        end
        result = sprintf('disp(''%s'');\n', block.name);
        for k = 1:numel(block.inputs) * block.labelled
            result = [result, sprintf('port_label(''input'', %d, ''%s'');\n', k, block.inputs{k})];
        end
        for k = 1:numel(block.outputs) * block.labelled
            result = [result, sprintf('port_label(''output'', %d, ''%s'');\n', k, block.outputs{k})];
        end
    case 'FMUName'
        result = 'the file';
    otherwise
        error('mock: get_param of %s', name);
end
end


function state = add_line_(state, from, to)
[source, output] = port(state, from, 'outputs');
[target, input] = port(state, to, 'inputs');
if any(cellfun(@(line) isequal(line(3:4), {target, input}), state.lines))
    error('mock: %s of %s is already connected', num2str(input), target);
end
state.lines{end + 1} = {source, output, target, input};
end


function [name, label] = port(state, handle, kind)
if ~isscalar(handle)
    error('mock: no such port');
end
b = floor(handle / 1000);
number = mod(handle, 1000) - 500 * strcmp(kind, 'outputs');
name = state.blocks{b}.name;
label = state.blocks{b}.(kind){number};
end


function b = find_block(state, name)
b = find(cellfun(@(block) strcmp(block.name, name), state.blocks));
if isempty(b)
    b = 0;
end
end


function name = name_of(state, path)
prefix = [state.model '/'];
if ~strncmp(path, prefix, numel(prefix))
    error('mock: %s is not in the model', path);
end
name = path(numel(prefix) + 1:end);
end


function cells = cellstr_(value)
cells = reshape(cellstr(value), 1, []);
if isempty(value)
    cells = {};
end
end
