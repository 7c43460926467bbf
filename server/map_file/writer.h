// Writes a map as a file, section by section: whoever sends it takes the next one when there is
// room. The layout is in MAP_FILE.md.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/strings/string_view.h"
#include "core/global/map_state.h"
#include "server/map_file/byte_writer.h"
#include "server/map_file/format.h"

namespace gem::map_file {

/// A section as it stands in a file.
std::string SectionOf(SectionType type, absl::string_view raw);

class Writer {
 public:
  explicit Writer(std::shared_ptr<const MapState> state);

  /// The next bytes, whole sections, about kRawBytes_aim before they are compressed; nothing once
  /// the file is complete.
  std::optional<std::string> Next();

 private:
  /// A section that is to be written: entries [first, last) of a list, or all of something.
  struct Step {
    SectionType type{};
    const SessionState* session = nullptr;
    const Submap* submap = nullptr;
    const FinishedSubmapState* finished = nullptr;  ///< null: the submap grows
    std::size_t first = 0;
    std::size_t last = 0;
  };

  void PlanSession(const SessionState& session);
  void PlanSubmap(const Submap& submap, const SessionState* session,
                  const FinishedSubmapState* finished);
  /// Steps of at most `count` entries each.
  void PlanList(Step step, std::size_t num_entries, std::size_t count);

  ByteWriter Write(const Step& step) const;
  void WriteMap(ByteWriter& to) const;
  void WriteSession(const SessionState& session, ByteWriter& to) const;
  void WriteSubmap(const Step& step, ByteWriter& to) const;
  void WriteSources(const Step& step, ByteWriter& to) const;

  const std::shared_ptr<const MapState> state_;
  absl::flat_hash_map<absl::string_view, std::uint32_t> place_of_;  ///< of sessions
  std::uint32_t num_pieces_ = 0;  ///< seen and hidden ones of finished submaps
  std::vector<Step> steps_;
  std::size_t next_ = 0;
};

}  // namespace gem::map_file
