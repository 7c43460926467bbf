// Names a field of a request for error messages: "scan.points[17].x". Costs nothing until an error
// is written: a path is a chain of stack objects, so a child must not outlive its parent.
#pragma once

#include <cstddef>
#include <string>

#include "absl/strings/str_cat.h"

namespace gem::wire {

class FieldPath {
 public:
  /// The request itself: its fields have no prefix.
  FieldPath() = default;
  explicit FieldPath(const char* name) : name_(name) {}

  /// The field `name` of this one.
  FieldPath Child(const char* name) const {
    FieldPath child(name);
    child.parent_ = this;
    return child;
  }
  /// Element `index` of this repeated field.
  FieldPath At(std::size_t index) const {
    FieldPath element;
    element.parent_ = this;
    element.index_ = index;
    return element;
  }

  std::string ToString() const {
    const std::string prefix = parent_ == nullptr ? std::string() : parent_->ToString();
    if (name_ == nullptr)
      return parent_ == nullptr ? prefix : absl::StrCat(prefix, "[", index_, "]");
    return prefix.empty() ? std::string(name_) : absl::StrCat(prefix, ".", name_);
  }

 private:
  const FieldPath* parent_ = nullptr;
  const char* name_ = nullptr;
  std::size_t index_ = 0;
};

}  // namespace gem::wire
