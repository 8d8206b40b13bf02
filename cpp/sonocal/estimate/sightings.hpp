// Which rows lie on one image line.
#pragma once

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <vector>

namespace sonocal {

// Rows in groups. A 2D probe sees a needle as one point: every row is its own group, and nothing is stored.
class Sightings {
 public:
  struct Range {
    const int* first;
    const int* last;
    const int* begin() const { return first; }
    const int* end() const { return last; }
    int size() const { return static_cast<int>(last - first); }
    int operator[](int i) const { return first[i]; }
  };

  static Sightings single_rows(int rows) {
    Sightings s;
    s.order_.resize(rows);
    std::iota(s.order_.begin(), s.order_.end(), 0);
    return s;
  }

  // codes[i]: the sighting of row i, 0, 1, ... without a gap.
  static Sightings of_codes(const std::int32_t* codes, int rows) {
    Sightings s;
    const int groups = rows == 0 ? 0 : 1 + *std::max_element(codes, codes + rows);
    s.begin_.assign(groups + 1, 0);
    for (int i = 0; i < rows; ++i) ++s.begin_[codes[i] + 1];
    std::partial_sum(s.begin_.begin(), s.begin_.end(), s.begin_.begin());
    s.order_.resize(rows);
    std::vector<int> next(s.begin_.begin(), s.begin_.end() - 1);
    for (int i = 0; i < rows; ++i) s.order_[next[codes[i]]++] = i;
    return s;
  }

  int size() const {
    return begin_.empty() ? static_cast<int>(order_.size()) : static_cast<int>(begin_.size()) - 1;
  }
  Range operator[](int i) const {
    const int* rows = order_.data();
    if (begin_.empty()) return {rows + i, rows + i + 1};
    return {rows + begin_[i], rows + begin_[i + 1]};
  }

 private:
  std::vector<int> order_;
  std::vector<int> begin_;  // empty: one row each
};

}  // namespace sonocal
