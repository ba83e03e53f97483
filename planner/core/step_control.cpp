#include "step_control.hpp"

namespace foldback {

void bind_step_control(nanobind::module_ &m) {
  namespace nb = nanobind;
  m.def(
      "adapt_tension",
      [](Controlled control, ControlLimits limits, double depth) {
        adapt_tension(control, limits, depth);
        return controlled_tuple(control);
      },
      nb::arg("control"), nb::arg("limits"), nb::arg("depth"),
      "Return the control of a step after its tension has adapted to the depth of contacts.");
  m.def(
      "limit_speeds",
      [](Controlled control, ControlLimits limits, double inverse_step_limit, Index contacts) {
        const double scale = limit_speeds(control, limits, inverse_step_limit, contacts);
        return nb::make_tuple(controlled_tuple(control), scale);
      },
      nb::arg("control"), nb::arg("limits"), nb::arg("inverse_step_limit"), nb::arg("contacts"),
      "Return the control of the next step, and the factor by which speeds are to be scaled.");
}

}  // namespace foldback
