// Contacts as Python passes them: the named tuples `PairContacts`, `ContactModel` and `Contacts`.
#pragma once

#include <span>

#include "bindings.hpp"
#include "contact_forces.hpp"

namespace foldback {

inline auto fields(PairContacts &c) { return std::tie(c.pairs, c.normals, c.points, c.depths); }
inline auto fields(ContactModel &m) {
  return std::tie(m.time_constant, m.damping_ratio, m.solimp, m.max_direct);
}
inline auto fields(Contacts &c) { return std::tie(c.points, c.model); }

inline void require_contacts(const PairContacts &contacts, Index n) {
  Index m = contacts.size();
  require(contacts.pairs.shape() == std::array<Index, 2>{m, 2}, "contacts.pairs: (m, 2)");
  require(contacts.normals.shape() == std::array<Index, 2>{m, 3}, "contacts.normals: (m, 3)");
  require(contacts.points.shape() == std::array<Index, 2>{m, 3}, "contacts.points: (m, 3)");
  for (Index i : std::span(contacts.pairs.begin(), contacts.pairs.end()))
    require(i >= 0 && i < n, "contacts.pairs: indices of modules");
}

inline void require_contact_model(const ContactModel &model) {
  require(model.solimp.size() == 5, "contact_model.solimp: (5,)");
}

}  // namespace foldback
