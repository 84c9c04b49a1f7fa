function older = verLessThan(~, wanted), older = str2double(getenv('MOCK_MATLAB')) < str2double(wanted); end
