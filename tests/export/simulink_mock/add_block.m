function add_block(varargin), mock_simulink('add_block', varargin{:}); end
