function new_system(varargin), mock_simulink('new_system', varargin{:}); end
