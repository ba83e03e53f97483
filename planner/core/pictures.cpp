// Pixels of triangles, and light that modules block from each other: for drawings without OpenGL.
#include <algorithm>
#include <cmath>
#include <vector>

#include "bindings.hpp"

namespace foldback {
namespace {

// Draw triangles over `picture`, the nearest one at each pixel. `nearness`, the inverse of the
// depth of what is drawn, is linear across a triangle, unlike the depth.
void draw_triangles(View<std::uint8_t, 3> picture, View<float, 2> nearness,
                    View<const float, 3> corners, View<const float, 3> colours) {
  const Index height = picture.axis(0), width = picture.axis(1);
  require(picture.axis(2) == 3 && nearness.axis(0) == height && nearness.axis(1) == width,
          "picture: (H, W, 3) bytes, nearness: (H, W)");
  require(corners.axis(1) == 3 && corners.axis(2) == 3 && corners.shape() == colours.shape(),
          "corners and colours: (T, 3, 3)");
  for (Index t = 0; t < corners.size(); ++t) {
    const double ax = corners(t, 0, 0), ay = corners(t, 0, 1), bx = corners(t, 1, 0),
                 by = corners(t, 1, 1), cx = corners(t, 2, 0), cy = corners(t, 2, 1);
    // Rows count downwards, so the area of a counterclockwise triangle is negative.
    const double area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    if (!(area < 0.0) || !std::isfinite(area)) continue;
    const auto first = [](double value, Index end) {
      return static_cast<Index>(std::clamp(value, 0.0, static_cast<double>(end)));
    };
    const Index left = first(std::min({ax, bx, cx}), width),
                right = first(std::max({ax, bx, cx}) + 1.0, width),
                top = first(std::min({ay, by, cy}), height),
                bottom = first(std::max({ay, by, cy}) + 1.0, height);
    double near[3];
    for (Index k = 0; k < 3; ++k) near[k] = 1.0 / corners(t, k, 2);
    for (Index row = top; row < bottom; ++row)
      for (Index column = left; column < right; ++column) {
        const double x = column + 0.5, y = row + 0.5;
        const double a = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area,
                     b = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area, c = 1.0 - a - b;
        if (a < 0.0 || b < 0.0 || c < 0.0) continue;
        const float depth = static_cast<float>(a * near[0] + b * near[1] + c * near[2]);
        if (depth <= nearness(row, column)) continue;
        nearness(row, column) = depth;
        for (Index k = 0; k < 3; ++k) {
          const double value =
              a * colours(t, 0, k) + b * colours(t, 1, k) + c * colours(t, 2, k) + 0.5;
          picture(row, column, k) = static_cast<std::uint8_t>(std::clamp(value, 0.0, 255.0));
        }
      }
  }
}

// Multiply the light of each face of module `i` by what the ball of another module lets through.
// A ball of radius r at distance d in direction u blocks the fraction r²/d² (n·u) of a uniform sky
// from a face with normal n (far field), and the part of the wide ray towards the light that passes
// within its radius. `fade` falls to 0 at the largest distance.
void block_light(Index i, View<const float, 1> ball, float fade, View<const float, 3> middles,
                 View<const float, 3> normals, float radius, View<const float, 1> light,
                 View<float, 2> sky, View<float, 2> key) {
  for (Index f = 0; f < middles.axis(1); ++f) {
    float square = 0.0f, ahead = 0.0f, along = 0.0f;
    for (Index k = 0; k < 3; ++k) {
      const float apart = ball[k] - middles(i, f, k);
      square += apart * apart;
      ahead += apart * normals(i, f, k);
      along += apart * light[k];
    }
    if (ahead > 0.0f)
      sky(i, f) *=
          1.0f -
          std::min(fade * ahead * radius * radius / (square * std::sqrt(square) + 1e-9f), 1.0f);
    if (along > 0.0f) {
      const float off = std::sqrt(std::max(square - along * along, 0.0f)),
                  penumbra = 0.25f + 0.35f * along,
                  share = std::clamp((radius - off) / penumbra + 0.5f, 0.0f, 1.0f);
      key(i, f) *= 1.0f - fade * share * share * (3.0f - 2.0f * share);
    }
  }
}

auto face_light(View<const float, 3> middles, View<const float, 3> normals,
                View<const float, 2> positions, float radius, View<const float, 1> light,
                float max_distance) {
  const Index n = middles.size(), faces = middles.axis(1);
  require(middles.axis(2) == 3 && middles.shape() == normals.shape(),
          "middles and normals: (n, F, 3)");
  require(positions.size() == n && positions.axis(1) == 3 && light.size() == 3,
          "positions: (n, 3), light: (3,)");
  std::vector<float> sky(n * faces, 1.0f), key(n * faces, 1.0f);
  const float limit = max_distance * max_distance;
  for (Index i = 0; i < n; ++i)
    for (Index j = 0; j < n; ++j) {
      float square = 0.0f;
      for (Index k = 0; k < 3; ++k) {
        const float apart = positions(j, k) - positions(i, k);
        square += apart * apart;
      }
      if (i != j && square <= limit)
        block_light(i, positions[j], 1.0f - square / limit, middles, normals, radius, light,
                    {sky.data(), {n, faces}}, {key.data(), {n, faces}});
    }
  return nanobind::make_tuple(owned_array(std::move(sky), {n, faces}),
                              owned_array(std::move(key), {n, faces}));
}

}  // namespace

void bind_pictures(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def("draw_triangles", draw_triangles, nb::arg("picture"), nb::arg("nearness"),
        nb::arg("corners"), nb::arg("colours"),
        "Draw triangles over a picture, the nearest one at each pixel.");
  m.def("face_light", face_light, nb::arg("middles"), nb::arg("normals"), nb::arg("positions"),
        nb::arg("radius"), nb::arg("light"), nb::arg("max_distance"),
        "Return the fractions of sky light and of key light that reach each face.");
}

}  // namespace foldback
