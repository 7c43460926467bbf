// Reads and writes the files of golden vectors, and turns what stands in them into what the codecs
// take. Part of the tests.
#pragma once

#include <google/protobuf/struct.pb.h>

#include <string>

#include "absl/strings/string_view.h"
#include "core/grid/layered_grid.h"

namespace google::protobuf {
class Message;
}  // namespace google::protobuf

namespace gem::golden {

/// Fills `message` from FOLDER/NAME.json. Aborts if it is not there or is something else.
void Read(const std::string& folder, const std::string& name, google::protobuf::Message* message);
/// The file's text: what fits a line stands on one. with_zeros: fields that are 0 or empty, too.
std::string ToText(const google::protobuf::Message& message, bool with_zeros = false);

/// Lower case, two digits a byte.
std::string Hex(absl::string_view bytes);

/// Cells as LayerCase has them.
google::protobuf::ListValue ListOf(const GridLayer& layer);
GridLayer LayerOf(Layer layer, const google::protobuf::ListValue& cells);
/// A float32 as the shortest number that is nearest to it.
void AddNumber(float value, google::protobuf::ListValue* list);

}  // namespace gem::golden
