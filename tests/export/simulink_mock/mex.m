function mex(varargin), mock_simulink('mex', varargin{:}); end
