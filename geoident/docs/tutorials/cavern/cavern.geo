// A cavern in three parts: heading, bench 1, bench 2. x across, y upwards from the floor, in m.
wall = 1.2; edge = 14; // size of the elements at the wall and at the edges of the model

Point(1) = {-10,  0, 0, wall}; Point(2) = {10,  0, 0, wall};
Point(3) = {-10,  6, 0, wall}; Point(4) = {10,  6, 0, wall};
Point(5) = {-10, 12, 0, wall}; Point(6) = {10, 12, 0, wall};
Point(7) = {-10, 15, 0, wall}; Point(8) = {10, 15, 0, wall};
Point(9) = {0, 22, 0, wall};   // crown
Point(10) = {0, 22 - 149 / 14, 0, wall}; // centre of the arch

Line(1) = {1, 2}; Line(2) = {3, 4}; Line(3) = {5, 6}; // floors
Line(4) = {1, 3}; Line(5) = {3, 5}; Line(6) = {5, 7}; // left wall
Line(7) = {2, 4}; Line(8) = {4, 6}; Line(9) = {6, 8}; // right wall
Circle(10) = {8, 10, 9}; Circle(11) = {9, 10, 7};     // arch

Point(11) = {-90, -80, 0, edge}; Point(12) = {90, -80, 0, edge};
Point(13) = {90, 100, 0, edge};  Point(14) = {-90, 100, 0, edge};
Line(12) = {11, 12}; Line(13) = {12, 13}; Line(14) = {13, 14}; Line(15) = {14, 11};

Curve Loop(1) = {3, 9, 10, 11, -6};
Curve Loop(2) = {2, 8, -3, -5};
Curve Loop(3) = {1, 7, -2, -4};
Curve Loop(4) = {12, 13, 14, 15};
Curve Loop(5) = {1, 7, 8, 9, 10, 11, -6, -5, -4};
Plane Surface(1) = {1};
Plane Surface(2) = {2};
Plane Surface(3) = {3};
Plane Surface(4) = {4, 5};

Physical Surface("heading") = {1};
Physical Surface("bench-1") = {2};
Physical Surface("bench-2") = {3};
Physical Surface("rock") = {4};
Physical Curve("bottom") = {12};
Physical Curve("right") = {13};
Physical Curve("left") = {15};
