// OpenCV lets its allocator be replaced; the rest of the protocol is that of its own one for plain memory.
#include "pipeline/large_pages.h"

#include <cstdlib>
#include <memory>
#include <new>

#include <opencv2/core/mat.hpp>

namespace granary {

namespace {

class LargePageAllocator : public cv::MatAllocator {
 public:
  cv::UMatData* allocate(int dims, const int* sizes, int type, void* given, std::size_t* step, cv::AccessFlag,
                         cv::UMatUsageFlags) const override {
    std::size_t bytes = CV_ELEM_SIZE(type);
    for (int i = dims - 1; i >= 0; --i) {
      if (step != nullptr) {
        if (given != nullptr && step[i] != cv::Mat::AUTO_STEP) {
          bytes = step[i];
        } else {
          step[i] = bytes;
        }
      }
      bytes *= static_cast<std::size_t>(sizes[i]);
    }
    auto data = std::make_unique<cv::UMatData>(this);
    data->data = data->origdata = static_cast<uchar*>(given != nullptr ? given : AllocateLarge(bytes));
    data->size = bytes;
    if (given != nullptr) data->flags |= cv::UMatData::USER_ALLOCATED;
    return data.release();
  }
  bool allocate(cv::UMatData* data, cv::AccessFlag, cv::UMatUsageFlags) const override { return data != nullptr; }
  void deallocate(cv::UMatData* data) const override {
    if (data == nullptr) return;
    if ((data->flags & cv::UMatData::USER_ALLOCATED) == 0) FreeLarge(data->origdata);
    delete data;
  }
};

}  // namespace

void* AllocateLarge(std::size_t bytes) {
  constexpr std::size_t kLine = 64, kLargePage = std::size_t{2} << 20;
  const std::size_t alignment = bytes < kLargePage ? kLine : kLargePage;
  const std::size_t whole = (bytes + alignment - 1) / alignment * alignment;
  void* memory = std::aligned_alloc(alignment, whole > 0 ? whole : kLine);
  if (memory == nullptr) throw std::bad_alloc();
  if (alignment == kLargePage) (void)madvise(memory, whole, MADV_HUGEPAGE);
  return memory;
}

void FreeLarge(void* memory) { std::free(memory); }

void UseLargePagesForPictures() {
  static LargePageAllocator allocator;
  cv::Mat::setDefaultAllocator(&allocator);
}

}  // namespace granary
