package Modelica "What the exported packages use of the Modelica Standard Library, for a parser without it"
  package Units
    package SI
      type Time = Real(final quantity = "Time", final unit = "s");
    end SI;
  end Units;
  package Blocks
    package Interfaces
      connector RealInput = input Real;
      connector RealOutput = output Real;
    end Interfaces;
    package Types
      type Smoothness = enumeration(LinearSegments, ConstantSegments);
      type Extrapolation = enumeration(HoldLastPoint, LastTwoPoints);
    end Types;
    package Sources
      block CombiTimeTable
        parameter Boolean tableOnFile = false;
        parameter String tableName = "NoName";
        parameter String fileName = "NoName";
        parameter Integer columns[:] = 2:2;
        parameter Types.Smoothness smoothness = Types.Smoothness.LinearSegments;
        parameter Types.Extrapolation extrapolation = Types.Extrapolation.LastTwoPoints;
        parameter Real shiftTime = 0.0;
        Interfaces.RealOutput y[size(columns, 1)];
      equation
        y = fill(0.0, size(columns, 1));
      end CombiTimeTable;
    end Sources;
  end Blocks;
  package Utilities
    package Files
      function loadResource
        input String uri;
        output String fileReference;
      algorithm
        fileReference := uri;
      end loadResource;
    end Files;
  end Utilities;
end Modelica;
