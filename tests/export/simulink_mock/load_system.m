function load_system(varargin), mock_simulink('load_system', varargin{:}); end
