// Conversion of Python's arguments: NumPy arrays to views, named tuples to structures.
#pragma once

#include <Python.h>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstring>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"

namespace foldback {

// Raise ValueError unless a condition on the shapes of the arguments holds.
inline void require(bool condition, const char *expected) {
  if (!condition) throw std::invalid_argument(expected);
}

// Return whether a buffer's format is that of T. Arrays that were read from files have a byte order
// before the letter.
template <class T>
constexpr bool has_format(const char *format) {
  if (format == nullptr) return false;
  const bool standard = *format == '<' || *format == '=';
  if (standard) ++format;
  if (*format == '\0' || format[1] != '\0') return false;
  const char letter = *format;
  if constexpr (std::is_same_v<T, double>) return letter == 'd';
  if constexpr (std::is_same_v<T, float>) return letter == 'f';
  if constexpr (std::is_same_v<T, bool>) return letter == '?';
  if constexpr (std::is_same_v<T, std::int16_t>) return letter == 'h';
  if constexpr (std::is_same_v<T, std::int8_t>) return letter == 'b';
  if constexpr (std::is_same_v<T, std::uint8_t>) return letter == 'B';
  const std::size_t length = letter == 'q'   ? 8
                             : letter == 'i' ? 4
                             : letter != 'l' ? 0
                             : standard      ? 4
                                             : sizeof(long);
  return (std::is_same_v<T, std::int64_t> || std::is_same_v<T, std::int32_t>) &&
         length == sizeof(T);
}

// Name of NumPy's type of T, for signatures.
template <class T>
constexpr auto dtype_name() {
  if constexpr (std::is_same_v<T, double>) return nanobind::detail::const_name("float64");
  if constexpr (std::is_same_v<T, float>) return nanobind::detail::const_name("float32");
  if constexpr (std::is_same_v<T, std::int64_t>) return nanobind::detail::const_name("int64");
  if constexpr (std::is_same_v<T, std::int32_t>) return nanobind::detail::const_name("int32");
  if constexpr (std::is_same_v<T, std::int16_t>) return nanobind::detail::const_name("int16");
  if constexpr (std::is_same_v<T, std::int8_t>) return nanobind::detail::const_name("int8");
  if constexpr (std::is_same_v<T, std::uint8_t>) return nanobind::detail::const_name("uint8");
  if constexpr (std::is_same_v<T, bool>) return nanobind::detail::const_name("bool_");
}

// NumPy array that owns its elements, given in C order: those of the vector, or flags of type bool
// if T is bool.
template <class T = void, class E, std::size_t N>
auto owned_array(std::vector<E> elements, const Index (&shape)[N]) {
  using Element = std::conditional_t<std::is_void_v<T>, E, T>;
  static_assert(sizeof(Element) == sizeof(E));
  std::size_t lengths[N];
  for (std::size_t k = 0; k < N; ++k) lengths[k] = static_cast<std::size_t>(shape[k]);
  auto *owner = new std::vector<E>(std::move(elements));
  nanobind::capsule deleter(owner,
                            [](void *p) noexcept { delete static_cast<std::vector<E> *>(p); });
  using Result = nanobind::ndarray<nanobind::numpy, Element, nanobind::ndim<N>>;
  return Result(static_cast<void *>(owner->data()), N, lengths, deleter);
}

// Named tuple of `planner.core.structures`.
template <class... Items>
nanobind::object named_tuple(const char *name, Items &&...items) {
  return nanobind::module_::import_("foldback.planner.core.structures")
      .attr(name)(std::forward<Items>(items)...);
}

// A named tuple whose items are, in this order, the fields that `fields` returns references to.
template <class S>
concept NamedTuple = requires(S &s) { fields(s); };

}  // namespace foldback

namespace nanobind::detail {

// Views by the buffer protocol, which is several times as fast as DLPack.
template <class T, int N>
struct type_caster<foldback::View<T, N>> {
  using Element = std::remove_const_t<T>;
  using Value = foldback::View<T, N>;
  template <class>
  using Cast = Value;
  static constexpr auto Name =
      const_name("numpy.typing.NDArray[numpy.") + foldback::dtype_name<Element>() + const_name("]");

  type_caster() = default;
  type_caster(const type_caster &) = delete;
  ~type_caster() {
    if (buffer_.obj) PyBuffer_Release(&buffer_);
  }

  bool from_python(handle source, std::uint32_t, cleanup_list *) noexcept {
    const int flags = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT |
                      (std::is_const_v<T> ? 0 : static_cast<int>(PyBUF_WRITABLE));
    if (PyObject_GetBuffer(source.ptr(), &buffer_, flags) != 0) {
      buffer_.obj = nullptr;
      PyErr_Clear();
      return false;
    }
    if (buffer_.ndim != N || !foldback::has_format<Element>(buffer_.format)) return false;
    std::array<foldback::Index, N> shape;
    for (int k = 0; k < N; ++k) shape[k] = buffer_.shape[k];
    value_ = Value(static_cast<T *>(buffer_.buf), shape);
    return true;
  }

  template <class>
  bool can_cast() const {
    return true;
  }
  operator Value() { return value_; }

 private:
  Py_buffer buffer_{};
  Value value_;
};

// Named tuples, item by item.
template <foldback::NamedTuple S>
struct type_caster<S> {
  using Value = S;
  template <class>
  using Cast = S;
  static constexpr auto Name = const_name("tuple");

  bool from_python(handle source, std::uint32_t flags, cleanup_list *cleanup) noexcept {
    if (!PyTuple_Check(source.ptr())) return false;
    return load(source, flags, cleanup, std::make_index_sequence<std::tuple_size_v<Casters>>());
  }

  template <class>
  bool can_cast() const {
    return true;
  }
  operator S() {
    S result{};
    assign(fields(result));
    return result;
  }

 private:
  template <class... F>
  static std::tuple<make_caster<F>...> casters_of(std::tuple<F &...>);
  using Casters = decltype(casters_of(fields(std::declval<S &>())));

  template <std::size_t... I>
  bool load(handle source, std::uint32_t flags, cleanup_list *cleanup,
            std::index_sequence<I...>) noexcept {
    if (PyTuple_Size(source.ptr()) != static_cast<Py_ssize_t>(sizeof...(I))) return false;
    return (std::get<I>(casters_).from_python(PyTuple_GetItem(source.ptr(), I), flags, cleanup) &&
            ...);
  }

  template <class... F>
  void assign(std::tuple<F &...> items) {
    [&]<std::size_t... I>(std::index_sequence<I...>) {
      ((std::get<I>(items) = std::get<I>(casters_).operator cast_t<F>()), ...);
    }(std::index_sequence_for<F...>());
  }
  Casters casters_;
};

}  // namespace nanobind::detail
