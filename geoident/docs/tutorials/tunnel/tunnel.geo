// Two tubes under a street and a building. x across, y upwards from the street, in m.
DefineConstant[ size = 1 ];
ring = 1.5 * size; near = 3.5 * size; far = 14 * size; // sizes of the elements
R = 3.2; depth = 16;

// the tubes, each a ring of four arcs: A at x = -9 m, B at x = 9 m
For t In {0:1}
  x = -9 + 18 * t; k = 10 * (t + 1);
  Point(k) = {x, -depth, 0, ring};
  Point(k + 1) = {x + R, -depth, 0, ring}; Point(k + 2) = {x, R - depth, 0, ring};
  Point(k + 3) = {x - R, -depth, 0, ring}; Point(k + 4) = {x, -R - depth, 0, ring};
  Circle(k + 1) = {k + 1, k, k + 2}; Circle(k + 2) = {k + 2, k, k + 3};
  Circle(k + 3) = {k + 3, k, k + 4}; Circle(k + 4) = {k + 4, k, k + 1};
  Curve Loop(k) = {k + 1, k + 2, k + 3, k + 4};
  Plane Surface(k) = {k};
EndFor

// the street, with the building from x = 2 m to 16 m; below it fill, clay and marl
Point(31) = {-70, 0, 0, far}; Point(32) = {-20, 0, 0, near}; Point(33) = {2, 0, 0, near / 2};
Point(34) = {16, 0, 0, near / 2}; Point(35) = {30, 0, 0, near}; Point(36) = {70, 0, 0, far};
Point(41) = {-70, -4, 0, far}; Point(42) = {0, -4, 0, near}; Point(43) = {70, -4, 0, far};
Point(51) = {-70, -27, 0, far}; Point(52) = {0, -27, 0, near}; Point(53) = {70, -27, 0, far};
Point(61) = {-70, -45, 0, far}; Point(62) = {70, -45, 0, far};
Line(31) = {31, 32}; Line(32) = {32, 33}; Line(33) = {33, 34}; Line(34) = {34, 35}; Line(35) = {35, 36};
Line(41) = {41, 42}; Line(42) = {42, 43}; Line(51) = {51, 52}; Line(52) = {52, 53}; Line(61) = {61, 62};
Line(71) = {41, 31}; Line(72) = {51, 41}; Line(73) = {61, 51}; // left side, upwards
Line(81) = {43, 36}; Line(82) = {53, 43}; Line(83) = {62, 53}; // right side, upwards
Curve Loop(1) = {41, 42, 81, -35, -34, -33, -32, -31, -71};
Curve Loop(2) = {51, 52, 82, -42, -41, -72};
Curve Loop(3) = {61, 83, -52, -51, -73};
Plane Surface(1) = {1};
Plane Surface(2) = {2, 10, 20};
Plane Surface(3) = {3};

Physical Surface("tube-a") = {10};
Physical Surface("tube-b") = {20};
Physical Surface("fill") = {1};
Physical Surface("clay") = {2};
Physical Surface("marl") = {3};
Physical Curve("building") = {33};
Physical Curve("ring-a") = {11:14};
Physical Curve("ring-b") = {21:24};
Physical Curve("sides") = {71:73, 81:83};
Physical Curve("bottom") = {61};
