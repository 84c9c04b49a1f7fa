function add_line(varargin), mock_simulink('add_line', varargin{:}); end
