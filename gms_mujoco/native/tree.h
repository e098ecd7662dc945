// Symmetric matrices with the sparsity of a kinematic tree.
#ifndef GMS_MUJOCO_NATIVE_TREE_H_
#define GMS_MUJOCO_NATIVE_TREE_H_

namespace gms {

// As MuJoCo stores its inertia: the lower triangle by rows, the diagonal last in each, and the columns of row i at the
// front of every row below that has a column i.
struct Tree {
  int n;
  const int *row_size, *row_start, *column;
  int size() const { return row_start[n - 1] + row_size[n - 1]; }
  int diagonal(int i) const { return row_start[i] + row_size[i] - 1; }
};

// L' D L in place, with a unit diagonal of L, from the leaves to the root; 1 / D apart.
inline void factor(const Tree& tree, double* value, double* inverse_diagonal) {
  for (int k = tree.n - 1; k >= 0; k--) {
    double* row = value + tree.row_start[k];
    const int* column = tree.column + tree.row_start[k];
    const int last = tree.row_size[k] - 1;
    const double inverse = 1 / row[last];
    inverse_diagonal[k] = inverse;
    for (int i = last - 1; i >= 0; i--) {
      double* above = value + tree.row_start[column[i]];
      const double ratio = row[i] * inverse;
      for (int j = 0; j <= i; j++) above[j] -= ratio * row[j];
      row[i] = ratio;
    }
  }
}

// Solves with the factor, in place.
inline void substitute(const Tree& tree, const double* factor, const double* inverse_diagonal, double* x) {
  for (int k = tree.n - 1; k >= 0; k--) {
    const double *row = factor + tree.row_start[k], value = x[k];
    const int *column = tree.column + tree.row_start[k], last = tree.row_size[k] - 1;
    if (value != 0) {
      for (int i = 0; i < last; i++) x[column[i]] -= row[i] * value;
    }
  }
  for (int k = 0; k < tree.n; k++) {
    const double* row = factor + tree.row_start[k];
    const int *column = tree.column + tree.row_start[k], last = tree.row_size[k] - 1;
    double value = x[k] * inverse_diagonal[k];
    for (int i = 0; i < last; i++) value -= row[i] * x[column[i]];
    x[k] = value;
  }
}

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_TREE_H_
