function close_system(varargin), mock_simulink('close_system', varargin{:}); end
