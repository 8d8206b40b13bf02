// Sorts by a number of each element.
#pragma once

#include <algorithm>
#include <utility>
#include <vector>

namespace sonocal {

// Numbers and places are sorted, and not the elements: a sort of its own for each kind of long elements is
// 10 KB of code each.
template <class T, class Number>
void sort_by(std::vector<T>& elements, const Number& number) {
  std::vector<std::pair<double, int>> order;
  order.reserve(elements.size());
  for (const T& element : elements) order.emplace_back(number(element), static_cast<int>(order.size()));
  std::sort(order.begin(), order.end());
  std::vector<T> sorted;
  sorted.reserve(elements.size());
  for (const auto& [least, place] : order) sorted.push_back(std::move(elements[place]));
  elements.swap(sorted);
}

}  // namespace sonocal
