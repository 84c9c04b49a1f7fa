function name = computer(), name = getenv('MOCK_COMPUTER'); end
