function found = ver(name), found = struct('Name', {}); if isempty(getenv('MOCK_NO_SIMULINK')), found = struct('Name', name); end, end
