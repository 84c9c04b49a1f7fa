function answer = bdIsLoaded(name), answer = mock_simulink('loaded', name); end
