function value = get_param(varargin), value = mock_simulink('get_param', varargin{:}); end
