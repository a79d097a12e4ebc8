// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace l4d::io {

// The convex set of pairs (x, y) of parameters that all samples so far allow, as a polygon, counter
// clockwise. A polygon of more corners than it holds loses the corner that costs least area, so
// that what stays is allowed.
class Region {
 public:
  struct Point {
    double x = 0, y = 0;
  };
  static constexpr size_t kMost = 8;

  Region() = default;
  // |x| <= a, |x + y - c| <= b: what two samples, at 0 and at 1, allow a line x + y t.
  static Region of_two_samples(double a, double c, double b) {
    Region r;
    r.put({-a, c - b + a});
    r.put({a, c - b - a});
    r.put({a, c + b - a});
    r.put({-a, c + b + a});
    return r;
  }
  static Region of_box(double x0, double x1, double y0, double y1) {
    Region r;
    r.put({x0, y0});
    r.put({x1, y0});
    r.put({x1, y1});
    r.put({x0, y1});
    return r;
  }

  size_t size() const { return size_; }
  const Point& operator[](size_t k) const { return corners_[k]; }
  bool empty() const { return size_ == 0; }

  // Keeps low <= u x + v y <= high.
  void keep_strip(double u, double v, double low, double high) {
    keep(u, v, high);
    keep(-u, -v, -low);
  }
  bool contains(const Point& p) const {
    if (size_ < 3) return false;
    for (size_t k = 0; k < size_; ++k) {
      const Point &a = corners_[k], &b = corners_[(k + 1) % size_];
      if ((b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x) < 0) return false;
    }
    return true;
  }
  Point middle() const {
    Point sum;
    for (size_t k = 0; k < size_; ++k) {
      sum.x += corners_[k].x;
      sum.y += corners_[k].y;
    }
    return {sum.x / static_cast<double>(size_), sum.y / static_cast<double>(size_)};
  }

 private:
  void put(const Point& p) { corners_[size_++] = p; }

  // Keeps u x + v y <= most.
  void keep(double u, double v, double most) {
    std::array<Point, kMost + 2> kept;
    size_t count = 0;
    for (size_t k = 0; k < size_; ++k) {
      const Point &a = corners_[k], &b = corners_[(k + 1) % size_];
      const double da = u * a.x + v * a.y - most, db = u * b.x + v * b.y - most;
      if (da <= 0) kept[count++] = a;
      if ((da < 0 && db > 0) || (da > 0 && db < 0)) {
        const double s = da / (da - db);
        kept[count++] = {a.x + s * (b.x - a.x), a.y + s * (b.y - a.y)};
      }
      if (count == kept.size()) break;  // rounding; a convex polygon gains one corner at most
    }
    while (count > kMost) drop_least(&kept, &count);
    size_ = count < 3 ? 0 : count;
    for (size_t k = 0; k < size_; ++k) corners_[k] = kept[k];
  }

  static void drop_least(std::array<Point, kMost + 2>* corners, size_t* count) {
    size_t least = 0;
    double area = HUGE_VAL;
    for (size_t k = 0; k < *count; ++k) {
      const Point& a = (*corners)[(k + *count - 1) % *count];
      const Point &b = (*corners)[k], &c = (*corners)[(k + 1) % *count];
      const double cut = std::abs((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x));
      if (cut < area) {
        area = cut;
        least = k;
      }
    }
    for (size_t k = least; k + 1 < *count; ++k) (*corners)[k] = (*corners)[k + 1];
    --*count;
  }

  std::array<Point, kMost> corners_;
  size_t size_ = 0;
};

}  // namespace l4d::io
