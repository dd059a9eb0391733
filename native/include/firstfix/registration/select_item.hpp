// The item that would be at a place if the items were sorted, with the lesser ones before it: quickselect, almost without
// branches that depend on the items.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace firstfix::detail {

// Splits items in two, as Hoare's partition does: those that are not less than the pivot change places, from the left on,
// with those that are not greater, from the right on. The first of the second part. There is an item that is not less, and,
// before it or beside `first`, one that is not greater.
template <class Item, class Number, class NumberOf>
Item* split_items(Item* first, Item* last, Number pivot, NumberOf of) {
  constexpr std::size_t kBlock = 64;
  std::uint8_t left[2 * kBlock], right[2 * kBlock];  // places, from either end, of items that are on the wrong side
  std::size_t lefts = 0, rights = 0, next_left = 0, next_right = 0;
  const auto find_left = [&](std::size_t count) {
    lefts = next_left = 0;
    for (std::size_t i = 0; i < count; ++i) {
      left[lefts] = static_cast<std::uint8_t>(i);
      lefts += static_cast<std::size_t>(!(of(first[i]) < pivot));
    }
  };
  const auto find_right = [&](std::size_t count) {
    rights = next_right = 0;
    for (std::size_t i = 0; i < count; ++i) {
      right[rights] = static_cast<std::uint8_t>(i);
      rights += static_cast<std::size_t>(!(pivot < of(*(last - 1 - i))));
    }
  };
  while (last - first > static_cast<std::ptrdiff_t>(2 * kBlock)) {
    if (next_left == lefts) find_left(kBlock);
    if (next_right == rights) find_right(kBlock);
    const std::size_t both = std::min(lefts - next_left, rights - next_right);
    for (std::size_t k = 0; k < both; ++k) std::swap(first[left[next_left + k]], *(last - 1 - right[next_right + k]));
    next_left += both, next_right += both;
    if (next_left == lefts) first += kBlock;
    if (next_right == rights) last -= kBlock;
  }
  if (next_left < lefts) first += left[next_left];  // those before it are where they belong
  if (next_right < rights) last -= right[next_right];
  const auto rest = static_cast<std::size_t>(last - first);
  lefts = rights = 0;
  for (std::size_t i = 0; i < rest; ++i) {  // both from the left on: each number is read once
    const Number number = of(first[i]);
    left[lefts] = right[rights] = static_cast<std::uint8_t>(i);
    lefts += static_cast<std::size_t>(!(number < pivot));
    rights += static_cast<std::size_t>(!(pivot < number));
  }
  std::size_t k = 0, end = rest;  // end: the last item that was swapped now begins what is not less
  for (; k < lefts && k < rights && left[k] < right[rights - 1 - k]; ++k) {
    end = right[rights - 1 - k];
    std::swap(first[left[k]], first[end]);
  }
  return first + (k < lefts ? std::min<std::size_t>(left[k], end) : end);
}

// Puts an item in the place of a heap's greatest one: the hole goes down to a leaf, and the item up from there.
template <class Item, class Less>
void replace_greatest(Item* heap, std::size_t size, Item item, Less less) {
  std::size_t hole = 0, child = 2;
  for (; child < size; child = 2 * hole + 2) {
    if (less(heap[child], heap[child - 1])) --child;
    heap[hole] = heap[child];
    hole = child;
  }
  if (child == size) heap[hole] = heap[child - 1], hole = child - 1;
  for (; hole > 0 && less(heap[(hole - 1) / 2], item); hole = (hole - 1) / 2) heap[hole] = heap[(hole - 1) / 2];
  heap[hole] = item;
}

// The least items become a heap, whose greatest is the one at `nth`.
template <class Item, class Less>
void select_by_heap(Item* first, Item* nth, Item* last, Less less) {
  std::make_heap(first, nth + 1, less);
  for (Item* item = nth + 1; item < last; ++item) {
    if (!less(*item, *first)) continue;
    const Item least = *item;
    *item = *first;
    replace_greatest(first, static_cast<std::size_t>(nth + 1 - first), least, less);
  }
  std::swap(*first, *nth);
}

// Sorts items as far as needed for the one at `nth`, by the numbers of(item). Equal to std::nth_element of GNU's library: the
// same items in the same places, with any library.
template <class Item, class NumberOf>
void select_item(Item* first, Item* nth, Item* last, NumberOf of) {
  const auto by_number = [of](const Item& a, const Item& b) { return of(a) < of(b); };
  int splits_left = 0;
  for (auto count = static_cast<std::size_t>(last - first); count > 1; count /= 2) splits_left += 2;
  while (last - first > 3) {
    if (splits_left-- == 0) return select_by_heap(first, nth, last, by_number);  // the pivots were unlucky ones
    Item *a = first + 1, *b = first + (last - first) / 2, *c = last - 1;
    if (!by_number(*a, *b)) std::swap(a, b);
    std::swap(*first, by_number(*b, *c) ? *b : by_number(*a, *c) ? *c : *a);  // the median of three
    Item* middle = split_items(first + 1, last, of(*first), of);
    (middle <= nth ? first : last) = middle;
  }
  for (Item* item = first; item < last; ++item) std::rotate(std::upper_bound(first, item, *item, by_number), item, item + 1);
}

}  // namespace firstfix::detail
