function set_param(varargin), mock_simulink('set_param', varargin{:}); end
