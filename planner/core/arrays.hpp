// Views of C-contiguous arrays that somebody else owns, and arrays that own their elements.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

#ifdef FOLDBACK_CHECK_INDICES
#include <cstdio>
#include <cstdlib>
#endif

namespace foldback {

using Index = std::int64_t;

// Abort if an index is out of range. Only builds for tests check: see CMakeLists.txt.
inline void check_index([[maybe_unused]] Index i, [[maybe_unused]] Index size) {
#ifdef FOLDBACK_CHECK_INDICES
  if (i < 0 || i >= size) {
    std::fprintf(stderr, "index %lld of an axis of %lld\n", static_cast<long long>(i),
                 static_cast<long long>(size));
    std::abort();
  }
#endif
}

// View of an array of N axes, in C order. A view of constant elements may read only.
template <class T, int N>
class View {
 public:
  View() = default;
  View(T *data, std::array<Index, N> shape) : data_(data), shape_(shape) {}

  // A view of elements that may be written is one of elements that may be read, too.
  template <class U>
    requires(std::is_same_v<const U, T>)
  View(const View<U, N> &other) : data_(other.data()), shape_(other.shape()) {}

  T *data() const { return data_; }
  const std::array<Index, N> &shape() const { return shape_; }
  Index size() const { return shape_[0]; }
  Index axis(int k) const { return shape_[k]; }

  // Element of a vector, or sub-array of one axis less.
  decltype(auto) operator[](Index i) const {
    check_index(i, shape_[0]);
    if constexpr (N == 1) {
      return data_[i];
    } else {
      std::array<Index, N - 1> shape;
      Index stride = 1;
      for (int k = 1; k < N; ++k) stride *= shape[k - 1] = shape_[k];
      return View<T, N - 1>(data_ + i * stride, shape);
    }
  }

  T &operator()(Index i, Index j) const
    requires(N == 2)
  {
    check_index(i, shape_[0]);
    check_index(j, shape_[1]);
    return data_[i * shape_[1] + j];
  }

  T &operator()(Index i, Index j, Index k) const
    requires(N == 3)
  {
    check_index(i, shape_[0]);
    check_index(j, shape_[1]);
    check_index(k, shape_[2]);
    return data_[(i * shape_[1] + j) * shape_[2] + k];
  }

  // Elements of the first axis from `begin` up to `end`.
  View slice(Index begin, Index end) const {
    View part = *this;
    Index stride = 1;
    for (int k = 1; k < N; ++k) stride *= shape_[k];
    part.data_ += begin * stride;
    part.shape_[0] = end - begin;
    return part;
  }

  T *begin() const { return data_; }
  T *end() const {
    Index count = 1;
    for (Index length : shape_) count *= length;
    return data_ + count;
  }

 private:
  T *data_ = nullptr;
  std::array<Index, N> shape_{};
};

// Array of N axes that owns its elements: zeros at first.
template <class T, int N>
class Array {
 public:
  explicit Array(std::array<Index, N> shape) : elements_(count(shape)), shape_(shape) {}

  operator View<T, N>() { return view(); }
  operator View<const T, N>() const { return {elements_.data(), shape_}; }
  View<T, N> view() { return {elements_.data(), shape_}; }
  decltype(auto) operator[](Index i) { return view()[i]; }
  template <class... I>
  T &operator()(I... i) {
    return view()(i...);
  }

 private:
  static std::size_t count(const std::array<Index, N> &shape) {
    std::size_t product = 1;
    for (Index length : shape) product *= static_cast<std::size_t>(length);
    return product;
  }
  std::vector<T> elements_;
  std::array<Index, N> shape_;
};

}  // namespace foldback
