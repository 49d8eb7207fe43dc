// Twin tunnels of radius 3 m under a road: made ground, clay and marl, 120 m wide and 40 m deep. Lengths in m.
SetFactory("Built-in");
DefineConstant[ size = 1.0 ];
R = 3; axis = -15; apart = 9; edge = 60;
fine = 1.15 * size; near = 3.5 * size; coarse = 9 * size;

// the two rings, anticlockwise from the right
For t In {0:1}
  x = (2 * t - 1) * apart; p = 10 * (t + 1);
  Point(p) = {x, axis, 0, 1.5 * fine};
  Point(p + 1) = {x + R, axis, 0, fine};
  Point(p + 2) = {x, axis + R, 0, fine};
  Point(p + 3) = {x - R, axis, 0, fine};
  Point(p + 4) = {x, axis - R, 0, fine};
  Circle(p + 1) = {p + 1, p, p + 2};
  Circle(p + 2) = {p + 2, p, p + 3};
  Circle(p + 3) = {p + 3, p, p + 4};
  Circle(p + 4) = {p + 4, p, p + 1};
  Curve Loop(p) = {p + 1, p + 2, p + 3, p + 4};
  Plane Surface(p) = {p};
  Point{p} In Surface {p};
EndFor

// the layers: surface, base of the made ground, base of the clay, bottom; the bases fall and rise across
Point(31) = {-edge, 0, 0, coarse};
Point(32) = {-20, 0, 0, near};
Point(33) = {20, 0, 0, near};
Point(34) = {edge, 0, 0, coarse};
Point(41) = {-edge, -4, 0, coarse};
Point(42) = {-20, -4 - 1 / 3, 0, near};
Point(43) = {20, -4 - 2 / 3, 0, near};
Point(44) = {edge, -5, 0, coarse};
Point(51) = {-edge, -26, 0, coarse};
Point(52) = {-20, -25, 0, near};
Point(53) = {20, -24, 0, near};
Point(54) = {edge, -23, 0, coarse};
Point(61) = {-edge, -40, 0, coarse};
Point(64) = {edge, -40, 0, coarse};
For k In {31:33}
  Line(k) = {k, k + 1};
  Line(k + 10) = {k + 10, k + 11};
  Line(k + 20) = {k + 20, k + 21};
EndFor
Line(61) = {61, 64};
For k In {1:3}
  Line(70 + k) = {21 + 10 * k, 31 + 10 * k};
  Line(80 + k) = {24 + 10 * k, 34 + 10 * k};
EndFor
Curve Loop(1) = {71, 41, 42, 43, -81, -33, -32, -31};
Curve Loop(2) = {72, 51, 52, 53, -82, -43, -42, -41};
Curve Loop(3) = {73, 61, -83, -53, -52, -51};
Plane Surface(1) = {1};
Plane Surface(2) = {2, 10, 20};
Plane Surface(3) = {3};

Physical Surface("tunnel-a") = {10};
Physical Surface("tunnel-b") = {20};
Physical Surface("made-ground") = {1};
Physical Surface("clay") = {2};
Physical Surface("marl") = {3};
Physical Curve("ring-a") = {11:14};
Physical Curve("ring-b") = {21:24};
Physical Curve("sides") = {71:73, 81:83};
Physical Curve("bottom") = {61};
