// What this machine allows: the STREAM triad, and steps of EVM bonds in space written by hand on
// the arrays of a simulation. Compiled by ceiling.py.
#include <cmath>
#include <cstdint>
#include <omp.h>

struct Arrays {  // as of warpdem.step.Step, flat
  void *displacement, *orientation, *velocity, *angular_velocity, *end_force, *end_torque;
  void *inverse_mass, *inverse_inertia, *direction, *length, *offset, *stiffness;
  int32_t *after, *before;
};

template <class T> struct Vec { T x, y, z; };
template <class T> static inline Vec<T> operator+(Vec<T> a, Vec<T> b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class T> static inline Vec<T> operator-(Vec<T> a, Vec<T> b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class T> static inline Vec<T> operator*(T s, Vec<T> a) { return {s * a.x, s * a.y, s * a.z}; }
template <class T> static inline T dot(Vec<T> a, Vec<T> b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
template <class T> static inline Vec<T> cross(Vec<T> a, Vec<T> b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <class T> static inline Vec<T> load(const T* a, int i) {
  return {a[3 * i], a[3 * i + 1], a[3 * i + 2]};
}
template <class T> static inline void store(T* a, int i, Vec<T> v) {
  a[3 * i] = v.x; a[3 * i + 1] = v.y; a[3 * i + 2] = v.z;
}

template <class T, int kinds> static void move(const Arrays& s, int n, T dt, int first, int last) {
  T* __restrict u = (T*)s.displacement; T* __restrict q = (T*)s.orientation;
  T* __restrict v = (T*)s.velocity; T* __restrict w = (T*)s.angular_velocity;
  const T* end_force = (T*)s.end_force; const T* end_torque = (T*)s.end_torque;
  const T* free = (T*)s.inverse_mass; const T* light = (T*)s.inverse_inertia;
  const int32_t* before = s.before;
#pragma GCC ivdep
  for (int i = first; i < last; ++i) {
    Vec<T> f{0, 0, 0}, t = load(end_torque, kinds * n + i);
#pragma GCC unroll 16
    for (int kind = 0; kind < kinds; ++kind) {
      int b = before[kind * n + i];
      f = f + load(end_force, kind * n + i) - load(end_force, b);
      t = t + load(end_torque, b);
    }
    Vec<T> a{free[3 * i] * f.x, free[3 * i + 1] * f.y, free[3 * i + 2] * f.z};
    Vec<T> vi = load(v, i) + dt * a, wi = load(w, i) + (dt * light[i]) * t;
    store(v, i, vi);
    store(w, i, wi);
    store(u, i, load(u, i) + dt * vi);
    // a turn by |w| dt: sine and cosine of half of it by their series, as angles of a step are small
    T x = T(0.25) * dt * dt * dot(wi, wi);
    T sine = T(0.5) * dt * (1 - x / 6 * (1 - x / 20 * (1 - x / 42)));
    T less = -x / 2 * (1 - x / 12 * (1 - x / 30 * (1 - x / 56)));
    Vec<T> p = sine * wi, r{q[4 * i], q[4 * i + 1], q[4 * i + 2]};
    T c = q[4 * i + 3];
    Vec<T> d = less * r + c * p + cross(p, r);
    T e = less * c - dot(p, r);
    T excess = (dot(r, r) + c * c - 1) + (2 * (dot(r, d) + c * e) + dot(d, d) + e * e);
    q[4 * i] = r.x + (d.x - T(0.5) * excess * r.x);
    q[4 * i + 1] = r.y + (d.y - T(0.5) * excess * r.y);
    q[4 * i + 2] = r.z + (d.z - T(0.5) * excess * r.z);
    q[4 * i + 3] = c + (e - T(0.5) * excess * c);
  }
}

// the compact form of Kuzkin's eq. 3 with turns as increments from the reference, for the bonds that
// begin at an element
template <class T, int kinds> static void bonds(const Arrays& s, int n, int first, int last) {
  const T* __restrict u = (T*)s.displacement; const T* __restrict q = (T*)s.orientation;
  T* __restrict end_force = (T*)s.end_force; T* __restrict end_torque = (T*)s.end_torque;
  const T* direction = (T*)s.direction; const T* length = (T*)s.length;
  const T* offset = (T*)s.offset; const T* stiffness = (T*)s.stiffness;
  const int32_t* after = s.after;
#pragma GCC ivdep
  for (int i = first; i < last; ++i) {
    Vec<T> ui = load(u, i), pi{q[4 * i], q[4 * i + 1], q[4 * i + 2]}, total{0, 0, 0};
    T ci = q[4 * i + 3];
#pragma GCC unroll 16
    for (int k = 0; k < kinds; ++k) {
      int j = after[k * n + i];
      T is_bond = j == i ? T(0) : T(1);
      Vec<T> e = load(direction, k), pj{q[4 * j], q[4 * j + 1], q[4 * j + 2]};
      T cj = q[4 * j + 3], a = length[k], ri = offset[2 * k], rj = offset[2 * k + 1];
      Vec<T> xi = T(2) * cross(pi, ci * e + cross(pi, e)), xj = T(2) * cross(pj, cj * e + cross(pj, e));
      Vec<T> delta = load(u, j) - ui - ri * xi - rj * xj;
      Vec<T> along = a * e + delta;
      T g = dot(T(2) * a * e + delta, delta) / (std::sqrt(dot(along, along)) + a);
      T over = 1 / (a + g);
      Vec<T> dd = over * (delta - g * e), d = e + dd, p = e + xi, m = e + xj;
      Vec<T> bend_i = xi - dd, bend_j = xj - dd, y = bend_i + bend_j;
      Vec<T> half = ci * pj - cj * pi - cross(pj, pi);
      T cosine = cj * ci + dot(pj, pi);
      T b1 = stiffness[4 * k], b2 = stiffness[4 * k + 1], b3 = stiffness[4 * k + 2];
      T b4 = stiffness[4 * k + 3];
      Vec<T> f = (b1 * g) * d - (T(0.5) * b2 * over) * (y - dot(y, d) * d);
      Vec<T> both = (b3 - T(0.5) * b4) * cross(p, xj - xi) + (2 * b4 * cosine) * half;
      total = total + is_bond * (ri * cross(p, f) - (T(0.5) * b2) * cross(d, bend_i) + both);
      store(end_force, k * n + i, is_bond * f);
      store(end_torque, k * n + i,
            is_bond * (rj * cross(m, f) - (T(0.5) * b2) * cross(d, bend_j) - both));
    }
    store(end_torque, kinds * n + i, total);
  }
}

template <class T> static void steps(const Arrays* s, int n, double dt, int k) {
#pragma omp parallel
  {
    int all = omp_get_num_threads(), own = omp_get_thread_num();
    auto part = [=](int size, int r) { return int(long(size) * r / all); };
    for (int step = 0; step < k; ++step) {
      move<T, 3>(*s, n, T(dt), part(n, own), part(n, own + 1));
#pragma omp barrier
      bonds<T, 3>(*s, n, part(n, own), part(n, own + 1));
#pragma omp barrier
    }
  }
}

extern "C" {
void share(int threads) { omp_set_num_threads(threads); }
void steps_float32(const Arrays* s, int n, double dt, int k) { steps<float>(s, n, dt, k); }
void steps_float64(const Arrays* s, int n, double dt, int k) { steps<double>(s, n, dt, k); }
void triad(double* __restrict a, const double* __restrict b, const double* __restrict c, long n) {
#pragma omp parallel for simd schedule(static)
  for (long i = 0; i < n; ++i) a[i] = b[i] + 3.0 * c[i];
}
}
