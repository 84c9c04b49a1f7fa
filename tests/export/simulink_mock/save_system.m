function save_system(varargin), mock_simulink('save_system', varargin{:}); end
