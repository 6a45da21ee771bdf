// Estimation of p by Gauss-Newton, a step for each control step: Python's `NewtonEstimator`, and how sure it is.

// 2 × 2 matrices, and vectors of 2.
const sum2 = (a, b) => a.map((row, i) => row.map((x, j) => x + b[i][j]));
const times2 = (a, x) => a.map((row) => row.map((each) => each * x));
const of2 = (a, v) => a.map((row) => row[0] * v[0] + row[1] * v[1]);
const product2 = (a, b) => a.map((row) => [0, 1].map((j) => row[0] * b[0][j] + row[1] * b[1][j]));
const outer2 = (a, b) => a.map((x) => b.map((y) => x * y));
const dot2 = (a, b) => a[0] * b[0] + a[1] * b[1];
const ZERO2 = [
  [0, 0],
  [0, 0],
];
function inverse2([[a, b], [c, d]]) {
  const determinant = a * d - b * c;
  return [
    [d / determinant, -b / determinant],
    [-c / determinant, a / determinant],
  ];
}
