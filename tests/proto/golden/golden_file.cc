#include "tests/proto/golden/golden_file.h"

#include <google/protobuf/message.h>
#include <google/protobuf/util/json_util.h>

#include <charconv>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "core/base/check.h"

namespace gem::golden {
namespace {

constexpr std::size_t kColumns = 100;

/// Members of an object or elements of an array, which is what lies between its brackets.
std::vector<absl::string_view> Parts(absl::string_view inside) {
  std::vector<absl::string_view> parts;
  std::size_t begin = 0;
  int depth = 0;
  bool in_text = false;
  for (std::size_t i = 0; i < inside.size(); ++i) {
    const char c = inside[i];
    if (c == '"' && (i == 0 || inside[i - 1] != '\\')) in_text = !in_text;
    if (in_text) continue;
    if (c == '{' || c == '[') ++depth;
    if (c == '}' || c == ']') --depth;
    if (c != ',' || depth > 0) continue;
    parts.push_back(inside.substr(begin, i - begin));
    begin = i + 1;
  }
  parts.push_back(inside.substr(begin));
  return parts;
}

/// Elements that hold nothing further, as many on a line as there is room for.
std::string Filled(const std::vector<absl::string_view>& parts, const std::string& indent) {
  std::string text = indent;
  std::size_t columns = indent.size();
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (i > 0 && columns + parts[i].size() >= kColumns) {
      absl::StrAppend(&text, "\n", indent);
      columns = indent.size();
    }
    absl::StrAppend(&text, parts[i], i + 1 < parts.size() ? "," : "\n");
    columns += parts[i].size() + 1;
  }
  return text;
}

/// Breaks what is longer than a line, member by member. Begins in the column behind `indent`.
std::string Broken(absl::string_view json, const std::string& indent) {
  const std::size_t bracket = json.find_first_of("{[");
  // Before the bracket of a member stands nothing but its name, which has none.
  if (indent.size() + json.size() <= kColumns || bracket == json.npos) return std::string(json);
  if (json.back() != '}' && json.back() != ']') return std::string(json);
  std::string text = absl::StrCat(json.substr(0, bracket + 1), "\n");
  const auto parts = Parts(json.substr(bracket + 1, json.size() - bracket - 2));
  if (json.substr(bracket + 1).find_first_of("{[") == json.npos && json.back() == ']')
    return absl::StrCat(text, Filled(parts, indent + "  "), indent, "]");
  for (std::size_t i = 0; i < parts.size(); ++i)
    absl::StrAppend(&text, indent, "  ", Broken(parts[i], indent + "  "),
                    i + 1 < parts.size() ? ",\n" : "\n");
  absl::StrAppend(&text, indent, json.substr(json.size() - 1));
  return text;
}

}  // namespace

void Read(const std::string& folder, const std::string& name, google::protobuf::Message* message) {
  std::ifstream file(absl::StrCat(folder, "/", name, ".json"));
  GEM_CHECK(file.good());
  const std::string text(std::istreambuf_iterator<char>(file), {});
  GEM_CHECK(google::protobuf::util::JsonStringToMessage(text, message).ok());
}

std::string ToText(const google::protobuf::Message& message, bool with_zeros) {
  google::protobuf::util::JsonPrintOptions options;
  options.always_print_primitive_fields = with_zeros;
  options.preserve_proto_field_names = true;
  std::string json;
  GEM_CHECK(google::protobuf::util::MessageToJsonString(message, &json, options).ok());
  return Broken(json, "") + "\n";
}

std::string Hex(absl::string_view bytes) { return absl::BytesToHexString(bytes); }

void AddNumber(float value, google::protobuf::ListValue* list) {
  char digits[32];
  *std::to_chars(digits, digits + sizeof(digits) - 1, value).ptr = '\0';
  list->add_values()->set_number_value(std::strtod(digits, nullptr));
}

google::protobuf::ListValue ListOf(const GridLayer& layer) {
  google::protobuf::ListValue list;
  for (std::size_t i = 0; i < layer.valid.size(); ++i) {
    if (layer.valid[i] == 0) {
      list.add_values()->set_null_value(google::protobuf::NULL_VALUE);
    } else if (layer.layer == Layer::kColor) {
      auto* channels = list.add_values()->mutable_list_value();
      for (int channel = 0; channel < 4; ++channel)
        channels->add_values()->set_number_value((layer.colors[i] >> (8 * channel)) & 0xff);
    } else {
      AddNumber(layer.values[i], &list);
    }
  }
  return list;
}

GridLayer LayerOf(Layer layer, const google::protobuf::ListValue& cells) {
  GridLayer result{layer, {}, {}, {}};
  for (const auto& cell : cells.values()) {
    const bool is_valid = !cell.has_null_value();
    result.valid.push_back(is_valid);
    if (layer != Layer::kColor) {
      result.values.push_back(is_valid ? static_cast<float>(cell.number_value()) : 0);
      continue;
    }
    Rgba color = 0;
    for (int channel = 0; is_valid && channel < 4; ++channel)
      color |= static_cast<Rgba>(cell.list_value().values(channel).number_value()) << (8 * channel);
    result.colors.push_back(color);
  }
  return result;
}

}  // namespace gem::golden
