//! Pages of a Parquet column that Zstandard compressed, without its C library.
//!
//! For the reader of pages nothing is compressed: it hands out their bytes as they stand in the file; what is
//! compressed of them is unpacked here.

use ::bytes::Bytes;
use parquet::basic::Compression;
use parquet::column::page::{Page, PageMetadata, PageReader};
use parquet::errors::{ParquetError, Result};
use parquet::file::metadata::ColumnChunkMetaData;
use parquet::file::serialized_reader::SerializedPageReader;
use std::io::Read;
use std::sync::Arc;

/// Most bytes of an unpacked page: a small file cannot fill the memory.
const PAGE_MAX: u64 = 1 << 28;

/// Unpacks page by page.
pub struct ZstandardPages(SerializedPageReader<Bytes>);

impl ZstandardPages {
    /// The pages of one column of one group of `rows` rows.
    pub fn of(file: &Arc<Bytes>, chunk: &ColumnChunkMetaData, rows: usize) -> Result<Self> {
        let as_it_stands = chunk
            .clone()
            .into_builder()
            .set_compression(Compression::UNCOMPRESSED)
            .build()?;
        SerializedPageReader::new(Arc::clone(file), &as_it_stands, rows, None).map(Self)
    }
}

/// The bytes with all but the first `plain` unpacked.
fn unpacked(bytes: &Bytes, plain: usize) -> Result<Bytes> {
    let wrong = |e: &dyn std::fmt::Display| {
        ParquetError::General(format!("a page compressed by Zstandard: {e}"))
    };
    let (before, packed) = bytes
        .split_at_checked(plain)
        .ok_or_else(|| wrong(&"is cut off"))?;
    let mut out = before.to_vec();
    // A page without values has nothing to unpack.
    if !packed.is_empty() {
        let decoder = ruzstd::decoding::StreamingDecoder::new(packed).map_err(|e| wrong(&e))?;
        let read = decoder
            .take(PAGE_MAX)
            .read_to_end(&mut out)
            .map_err(|e| wrong(&e))?;
        if read as u64 == PAGE_MAX {
            return Err(wrong(&format_args!("is larger than {PAGE_MAX} bytes")));
        }
    }
    Ok(out.into())
}

impl PageReader for ZstandardPages {
    fn get_next_page(&mut self) -> Result<Option<Page>> {
        let Some(mut page) = self.0.get_next_page()? else {
            return Ok(None);
        };
        match &mut page {
            Page::DataPage { buf, .. } | Page::DictionaryPage { buf, .. } => {
                *buf = unpacked(buf, 0)?
            }
            // Levels stand before the values and are never compressed.
            Page::DataPageV2 {
                buf,
                def_levels_byte_len,
                rep_levels_byte_len,
                is_compressed,
                ..
            } if *is_compressed => {
                *buf = unpacked(
                    buf,
                    *def_levels_byte_len as usize + *rep_levels_byte_len as usize,
                )?;
            }
            Page::DataPageV2 { .. } => {}
        }
        Ok(Some(page))
    }

    fn peek_next_page(&mut self) -> Result<Option<PageMetadata>> {
        self.0.peek_next_page()
    }

    fn skip_next_page(&mut self) -> Result<()> {
        self.0.skip_next_page()
    }

    fn at_record_boundary(&mut self) -> Result<bool> {
        self.0.at_record_boundary()
    }
}

impl Iterator for ZstandardPages {
    type Item = Result<Page>;

    fn next(&mut self) -> Option<Self::Item> {
        self.get_next_page().transpose()
    }
}
